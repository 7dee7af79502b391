"""An interaction and a scene that are varied and simulated again, with nothing of a page."""

import threading
from collections.abc import Callable

import numpy as np

from icjax.interaction import Interaction
from icjax.rollout import Rollout
from icjax.synthesis import MOST_FAILED, Policy, Scene, transfer
from icjax.view._rerun import Rerun, Told
from icjax.view._variation import Variation, varied_interaction, varied_scene


class Explorer:
    """Runs transfers in the background and keeps the last one that went well.

    A variation in numbers runs the compiled step again; another shape is compiled once.

    **Arguments**: `interaction`, `scene` and `policy` as for [`icjax.synthesis.transfer`]; `told` of every change of
    state, in another thread; `pause` s without a further request before one is computed.

    **Fields**: `variation` asked for last; `rollout` the last good one, None before the first; `told` the state.
    """

    def __init__(
        self,
        interaction: Interaction,
        scene: Scene,
        policy: Policy | None = None,
        told: Callable[[Told], None] = lambda told: None,
        pause: float = 0.3,
    ):
        self.interaction, self.scene, self.policy = interaction, scene, policy
        self.variation = Variation()
        self.rollout: Rollout | None = None
        self.told = Told("computing")
        self._listener = told
        self._lock = threading.Lock()
        self._rerun = Rerun(self._simulate, self._keep, self._tell, pause)
        self.vary(self.variation)

    def vary(self, variation: Variation) -> None:
        """Ask for another one."""
        self.variation = variation
        self._rerun.ask(variation)

    def take(self) -> tuple[Rollout | None, Told]:
        """The last good rollout and the state."""
        with self._lock:
            return self.rollout, self.told

    def wait(self, timeout: float | None = None) -> bool:
        """Until nothing is asked for or computed. **Returns**: False if that took longer than `timeout` s."""
        return self._rerun.wait(timeout)

    def close(self) -> None:
        """End the thread."""
        self._rerun.close()

    def _simulate(self, variation: Variation, progress: Callable[[float], None]) -> Rollout:
        interaction, scene = varied_interaction(self.interaction, variation), varied_scene(self.scene, variation)
        rollout = transfer(interaction, scene, progress=progress, policy=self.policy)
        failed = float(np.mean(np.asarray(rollout.status) != 0))
        if failed > MOST_FAILED:
            raise ValueError(f"{failed:.0%} of the steps could not be solved")
        return rollout

    def _keep(self, variation: Variation, rollout: Rollout) -> None:
        with self._lock:
            self.rollout = rollout

    def _tell(self, told: Told) -> None:
        with self._lock:
            self.told = told
        self._listener(told)

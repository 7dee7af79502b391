# pyright: reportGeneralTypeIssues=false
# (the checker does not see that `labelled`, `names` and `static` declare fields without a default)
"""Hinge 3: what happened in simulation."""

import json
import os

import equinox as eqx

from icjax.files import labelled, load_record, names, optional, save_record, static
from icjax.model import Model
from icjax.typing import Float, Int, Real

SLIP_STATES = ("open", "sticking", "sliding")
"""Meaning of `Rollout.slip_state`, by its number."""


class Rollout(eqx.Module):
    """Simulated interaction: one row a time step, one column a contact slot (pad or corner, and what it touches).

    Forces act on the first body of the slot's name, world axes. A masked or open slot carries zero force. What is
    stated of objects is None where there are none.
    """

    name: str = static()
    model: Model
    scene: str = static()  # JSON text: surfaces, friction, step, facets, as given
    time: Float[Real, " time"] = labelled("time", unit="s")
    q: Float[Real, "time coordinate"] = labelled("time", "coordinate", unit="rad or m")
    reference: Float[Real, "time coordinate"] = labelled("time", "coordinate", unit="rad or m")
    torque: Float[Real, "time dof"] = labelled("time", "dof", unit="Nm", doc="of the contact forces, Eq. 2")
    slot_names: tuple[str, ...] = names("slot")
    contact_force: Float[Real, "time slot 3"] = labelled("time", "slot", "axis", unit="N")
    contact_point: Float[Real, "time slot 3"] = labelled("time", "slot", "axis", unit="m")
    contact_normal: Float[Real, "time slot 3"] = labelled("time", "slot", "axis", unit="1")
    gap: Float[Real, "time slot"] = labelled("time", "slot", unit="m", doc="of the undeformed bodies, negative inside")
    slip_state: Int[Real, "time slot"] = labelled("time", "slot", unit="1", doc="index into SLIP_STATES")
    equilibrium_error: Float[Real, "time dof"] = labelled(
        "time", "dof", unit="rad or m", doc="theta_err of Eq. 7 after the step"
    )
    residual: Float[Real, " time"] = labelled("time", unit="1", doc="complementarity residual, dimensionless")
    status: Int[Real, " time"] = labelled("time", unit="1", doc="0 where the step was solved, else the RESULTS index")
    margin: Float[Real, " time"] = labelled("time", unit="1", doc="distance from a change of contact state")
    limit_torque: Float[Real, "time dof"] | None = optional("time", "dof", unit="Nm", doc="of the joint limits")
    compliance: Float[Real, "time dof"] | None = optional("time", "dof", unit="rad/Nm", doc="that was stepped with")
    object_names: tuple[str, ...] = names("object", default=())
    object_position: Float[Real, "time object 3"] | None = optional(
        "time", "object", "axis", unit="m", doc="origin of the object's frame, world"
    )
    object_quaternion: Float[Real, "time object 4"] | None = optional(
        "time", "object", "wxyz", unit="1", doc="rotation from the object's frame to world"
    )
    object_velocity: Float[Real, "time object 3"] | None = optional(
        "time", "object", "axis", unit="m/s", doc="of the centre of mass, world"
    )
    object_angular_velocity: Float[Real, "time object 3"] | None = optional(
        "time", "object", "axis", unit="rad/s", doc="mean over the step, world"
    )

    def slot_bodies(self) -> tuple[tuple[str, str], ...]:
        """First and second body of every slot; an object's corner is the object, the end of a capsule its pad.

        **Returns**: of the slot ``cube.3/plate``, for example, (``cube``, ``plate``).
        """
        halves = [name.rpartition("/")[::2] for name in self.slot_names]
        return tuple((self._body(first), self._body(second)) for first, second in halves)

    def on_hand(self) -> tuple[bool, ...]:
        """Whether the force of a slot acts on the hand; else it acts on an object."""
        return tuple(first not in self.object_names for first, _ in self.slot_bodies())

    def friction_of(self, first: str, second: str) -> float | None:
        """Coulomb's coefficient of two bodies of a slot, as the scene states it.

        That of the pair where it has one of its own, else the smaller of both; a pad has that of what it touches.

        **Returns**: None where the scene does not know the second one.
        """
        scene = json.loads(self.scene) if self.scene else {}
        for pair in reversed(scene.get("frictions", [])):
            if set(pair["names"]) == {first, second}:
                return float(pair["friction"])
        things = [*scene.get("surfaces", []), *scene.get("objects", [])]
        stated = {item.get("name"): float(item["friction"]) for item in things if "friction" in item}
        if second not in stated:
            return None
        return min(stated[second], stated.get(first, stated[second]))

    def _body(self, label: str) -> str:
        known = (*self.object_names, *self.model.pad_names)
        if label in known:
            return label
        return max((name for name in known if label.startswith(f"{name}.")), key=len, default=label)

    def save(self, path: str | os.PathLike) -> None:
        """Write one labelled netCDF file, complete or not at all."""
        save_record(path, self)

    @staticmethod
    def load(path: str | os.PathLike) -> "Rollout":
        """Read a rollout back, equal to what was saved. **Errors**: `FileError` naming the file."""
        return load_record(path, Rollout)

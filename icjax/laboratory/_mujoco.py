"""MuJoCo for type checkers, which cannot see the classes that it makes at import."""

import importlib
from typing import Any, TypeAlias

mujoco: Any = importlib.import_module("mujoco")
rollout: Any = importlib.import_module("mujoco.rollout").rollout

MjModel: TypeAlias = Any
MjData: TypeAlias = Any

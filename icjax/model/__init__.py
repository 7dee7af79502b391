"""Articulated bodies: kinematic tree, kinematics and dynamics, loading, the shipped finger."""

from icjax.model._model import Model as Model

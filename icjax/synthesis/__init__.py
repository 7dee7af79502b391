"""Interaction synthesis: an interaction, a scene, one contact problem a time step (Section 7)."""

from icjax.synthesis._bodies import Admittance as Admittance
from icjax.synthesis._bodies import QuasiStaticHand as QuasiStaticHand
from icjax.synthesis._bodies import Target as Target
from icjax.synthesis._check_rollout import check_rollout as check_rollout
from icjax.synthesis._contacts import Contacts as Contacts
from icjax.synthesis._contacts import find_contacts as find_contacts
from icjax.synthesis._contacts import slot_names as slot_names
from icjax.synthesis._coupled import PARTING as PARTING
from icjax.synthesis._object import Motion as Motion
from icjax.synthesis._object import Object as Object
from icjax.synthesis._object import object_admittance as object_admittance
from icjax.synthesis._object import rigid_admittance as rigid_admittance
from icjax.synthesis._policies import GripTightening as GripTightening
from icjax.synthesis._policies import ImminentSlip as ImminentSlip
from icjax.synthesis._policies import Policy as Policy
from icjax.synthesis._read_scene import read_scene as read_scene
from icjax.synthesis._rollout import rollout as rollout
from icjax.synthesis._scene import PairFriction as PairFriction
from icjax.synthesis._scene import Scene as Scene
from icjax.synthesis._stepper import State as State
from icjax.synthesis._stepper import StepInfo as StepInfo
from icjax.synthesis._stepper import init as init
from icjax.synthesis._stepper import step as step
from icjax.synthesis._surface import Surface as Surface
from icjax.synthesis._transfer import resample as resample
from icjax.synthesis._transfer import transfer as transfer

"""From a recording to an interaction trajectory: joint torque, compliance at contact, reference trajectory."""

from icjax.estimation._contact_compliance import compliance_at_contact as compliance_at_contact
from icjax.estimation._estimate import estimate as estimate
from icjax.estimation._joints import compliant_dofs as compliant_dofs
from icjax.estimation._options import EstimationOptions as EstimationOptions
from icjax.estimation._reference import CompliancePath as CompliancePath
from icjax.estimation._reference import compliance_path as compliance_path
from icjax.estimation._reference import reference_trajectory as reference_trajectory
from icjax.estimation._summary import pool as pool
from icjax.estimation._summary import summarise as summarise
from icjax.estimation._torque import contact_torque as contact_torque
from icjax.estimation._torque import joint_torque as joint_torque
from icjax.estimation._torque_error import TorqueDeviation as TorqueDeviation
from icjax.estimation._torque_error import torque_deviation as torque_deviation

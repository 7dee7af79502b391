"""Files: arrays in, arrays out, no physics. SI units inside; readers say what the file held."""

from icjax.files._bvh import read_bvh as read_bvh
from icjax.files._c3d import read_c3d as read_c3d
from icjax.files._c3d_write import write_c3d as write_c3d
from icjax.files._csv import read_csv as read_csv
from icjax.files._errors import FileError as FileError
from icjax.files._motion import ForcePlate as ForcePlate
from icjax.files._motion import MotionEvent as MotionEvent
from icjax.files._motion import MotionFile as MotionFile
from icjax.files._records import labelled as labelled
from icjax.files._records import load_record as load_record
from icjax.files._records import names as names
from icjax.files._records import optional as optional
from icjax.files._records import record_kind as record_kind
from icjax.files._records import save_record as save_record
from icjax.files._records import static as static
from icjax.files._sto import read_sto as read_sto
from icjax.files._sto_write import write_sto as write_sto
from icjax.files._toml import Table as Table
from icjax.files._toml import as_numbers as as_numbers
from icjax.files._toml import as_rotation as as_rotation
from icjax.files._toml import read_toml as read_toml
from icjax.files._trc import read_trc as read_trc
from icjax.files._trc_write import write_trc as write_trc
from icjax.files._tsv import is_qualisys as is_qualisys
from icjax.files._tsv import read_tsv as read_tsv

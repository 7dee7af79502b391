"""Virtual capture studio: an independent MuJoCo subject that is recorded as a motion-capture laboratory would.

Nothing here is shared with the estimators or the synthesis; the truth is written apart from the recording.
"""

from icjax.laboratory._dynamics import Truth as Truth
from icjax.laboratory._instruments import Noise as Noise
from icjax.laboratory._record import Paths as Paths
from icjax.laboratory._record import record as record
from icjax.laboratory._replay import bump_under as bump_under
from icjax.laboratory._replay import load_truth as load_truth
from icjax.laboratory._replay import replay as replay
from icjax.laboratory._subject import Subject as Subject
from icjax.laboratory._surface import Bump as Bump
from icjax.laboratory._surface import Surface as Surface

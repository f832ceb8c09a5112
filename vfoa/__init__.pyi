from typing import Final

from vfoa.errors import VfoaError as VfoaError
from vfoa.estimate import Estimate as Estimate
from vfoa.estimate import Look as Look
from vfoa.estimator import Estimator as Estimator
from vfoa.estimator import Follower as Follower
from vfoa.estimator import rectified_rig as rectified_rig
from vfoa.measured import Observed as Observed
from vfoa.measured_follower import MeasuredFollower as MeasuredFollower
from vfoa.pipeline import Stages as Stages
from vfoa.scoring import Score as Score
from vfoa.scoring import score as score
from vfoa.types import StereoFrame as StereoFrame
from vfoa.types import StereoRig as StereoRig

__version__: Final[str]

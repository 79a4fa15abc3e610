"""What a package needs for a plant of its own: docs/plant.md."""

from trunk_core.elementary import atan2 as atan2
from trunk_core.elementary import cos as cos
from trunk_core.elementary import exp as exp
from trunk_core.elementary import log as log
from trunk_core.elementary import sin as sin
from trunk_core.elementary import sincos as sincos
from trunk_core.elementary import sqrt as sqrt
from trunk_core.elementary import tanh as tanh
from trunk_core.parameters.declarations import ParameterError as ParameterError
from trunk_core.parameters.declarations import parameter as parameter
from trunk_msgs_util.picture.frames import BASE as BASE
from trunk_msgs_util.picture.frames import BODY as BODY
from trunk_msgs_util.picture.frames import Frame as Frame
from trunk_msgs_util.picture.frames import Picture as Picture
from trunk_msgs_util.picture.frames import Scaled as Scaled
from trunk_msgs_util.picture.frames import Track as Track
from trunk_msgs_util.picture.frames import Visual as Visual

from .plant import Coordinate as Coordinate
from .plant import Plant as Plant
from .plant import PlantConfig as PlantConfig
from .plant import PlantState as PlantState

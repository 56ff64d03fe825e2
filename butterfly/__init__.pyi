from .api.drawn import Drawn as Drawn
from .api.identified import Identified as Identified
from .api.looking_ahead import draws as draws
from .api.looking_ahead import predict as predict
from .api.predicted import Predicted as Predicted
from .api.saved import load as load
from .api.sources import read as read
from .api.sources import read_experiment as read_experiment
from .api.tabulated import Compared as Compared
from .api.tabulated import Designed as Designed
from .api.tabulated import Validated as Validated
from .api.verbs import compare as compare
from .api.verbs import design as design
from .api.verbs import identify as identify
from .api.verbs import simulate as simulate
from .api.verbs import validate as validate
from .errors import ButterflyError as ButterflyError
from .errors import IdentifiabilityError as IdentifiabilityError
from .errors import InputError as InputError
from .identify.data import DataSet as DataSet
from .logs.log import InputKind as InputKind
from .logs.log import Intersample as Intersample
from .logs.log import Log as Log
from .logs.log import Sine as Sine
from .model.parameters import AddedMass as AddedMass
from .model.parameters import LumpedParameters as LumpedParameters

__version__: str

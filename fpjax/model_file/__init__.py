"""servo.toml: the nominal model as a file, read by every command."""

from .keys import Units as Units
from .model import Model as Model
from .model import ModelSource as ModelSource
from .reading import load_model as load_model
from .simplify import simplified as simplified
from .writing import dump_model as dump_model

"""The Friedland-Park observers."""

from .base import Absolute as Absolute
from .base import AbstractNonlinearity as AbstractNonlinearity
from .base import AbstractObserver as AbstractObserver
from .base import LogCosh as LogCosh
from .base import NoObserver as NoObserver
from .base import Quadratic as Quadratic
from .extended import ExtendedFriedlandPark as ExtendedFriedlandPark
from .extended import ExtendedSteepnessCoulomb as ExtendedSteepnessCoulomb
from .extended import ExtendedSteepnessViscous as ExtendedSteepnessViscous
from .high_order import HighOrderFeedforward as HighOrderFeedforward
from .single import ClassicalFriedlandPark as ClassicalFriedlandPark
from .single import ModifiedFriedlandPark as ModifiedFriedlandPark
from .single import NovelFriedlandPark as NovelFriedlandPark
from .single import SteepnessObserver as SteepnessObserver

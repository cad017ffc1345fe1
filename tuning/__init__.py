"""Tuning: gains by Algorithm 1, dense sweeps and gradients, on any named parameters of any block."""

from .identifiability import Identifiability as Identifiability
from .methods import LBFGS as LBFGS
from .methods import Adam as Adam
from .methods import GridSearch as GridSearch
from .methods import LevenbergMarquardt as LevenbergMarquardt
from .methods import NelderMead as NelderMead
from .methods import RepairedGridSearch as RepairedGridSearch
from .objective import AbstractObjective as AbstractObjective
from .objective import Estimation as Estimation
from .objective import Thesis as Thesis
from .objective import Tracking as Tracking
from .parameters import Parameter as Parameter
from .population import population as population
from .result import TuningResult as TuningResult
from .setup import Setup as Setup
from .sweep import sweep as sweep
from .sweep_axis import Axis as Axis
from .sweep_result import SweepResult as SweepResult
from .sweep_result import load_sweep as load_sweep
from .tune import tune as tune
from .tune import tune_each as tune_each

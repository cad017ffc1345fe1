"""Friction laws: a torque [N m] that opposes the motion."""

from .base import AbstractFriction as AbstractFriction
from .base import AbstractStaticFriction as AbstractStaticFriction
from .base import direction as direction
from .base import log_cosh as log_cosh
from .base import safe_power as safe_power
from .dynamic import Dahl as Dahl
from .dynamic import LuGre as LuGre
from .static import AsymmetricCoulombViscous as AsymmetricCoulombViscous
from .static import Coulomb as Coulomb
from .static import CoulombViscous as CoulombViscous
from .static import CoulombViscousStiction as CoulombViscousStiction
from .static import NoFriction as NoFriction
from .static import SmoothCoulomb as SmoothCoulomb
from .static import Stribeck as Stribeck
from .static import Viscous as Viscous
from .static import stribeck_curve as stribeck_curve

"""Plants: one mass, two masses on a shaft or in series, a transmission; with steps that resolve sticking exactly."""

from .masses import AbstractPlant as AbstractPlant
from .masses import OneMass as OneMass
from .masses import OneMassState as OneMassState
from .masses import SeriesTwoMass as SeriesTwoMass
from .masses import SeriesTwoMassState as SeriesTwoMassState
from .masses import TwoMass as TwoMass
from .masses import TwoMassState as TwoMassState
from .masses import held_high_order as held_high_order
from .masses import high_order_derivative as high_order_derivative
from .masses import high_order_output as high_order_output
from .masses import resonance_frequency as resonance_frequency

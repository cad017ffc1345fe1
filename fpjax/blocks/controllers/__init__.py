"""Controllers: P, PI, lead, any transfer function; a position loop around the velocity loop, and a limit."""

from .around import Limited as Limited
from .around import PositionLoop as PositionLoop
from .base import AbstractController as AbstractController
from .lead import Lead as Lead
from .lead import design_lead as design_lead
from .lead import phase_lead_for_margin as phase_lead_for_margin
from .proportional import Proportional as Proportional
from .proportional import ProportionalIntegral as ProportionalIntegral
from .proportional import TorqueInput as TorqueInput
from .transfer_function import TransferFunction as TransferFunction

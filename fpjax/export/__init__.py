"""A model for other machines: its control law as C, its body as MuJoCo or URDF."""

from .c_export import ExportedC as ExportedC
from .c_export import export_c as export_c

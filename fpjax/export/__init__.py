"""Export of a model: its control law as C, its mechanics as MuJoCo (MJCF) or URDF."""

from .body_export import ExportedBody as ExportedBody
from .body_export import export_mujoco as export_mujoco
from .body_export import export_urdf as export_urdf
from .c_export import ExportedC as ExportedC
from .c_export import export_c as export_c

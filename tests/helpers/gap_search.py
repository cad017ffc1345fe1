"""The nominal model of `gap_machine.Machine`, and a search of the diagnosis over one of its logs."""

from fpjax.gap.diagnose import make_search
from fpjax.model_file import load_model

MODEL = """[plant]
type = "one_mass"
inertia = 0.05
[friction]
type = "coulomb_viscous"
coulomb = 0.4
viscous = 0.03
[controller]
type = "unknown"
[simulation]
dt = 1e-3
"""


def search_of(log):
    return make_search([log], [], load_model(MODEL))

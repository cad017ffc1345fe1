"""The nominal model of `machine.Machine`, and a search of the diagnosis over one of its logs."""

from model_files import SMALL_BODY

from fpjax.gap.verb import make_search
from fpjax.model_file import load_model

MODEL = (
    SMALL_BODY
    + """
[controller]
type = "unknown"
[simulation]
dt = 1e-3
"""
)


def search_of(log, model=MODEL):
    return make_search([log], [], load_model(model))

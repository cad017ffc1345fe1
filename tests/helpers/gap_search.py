"""The nominal model of `machine.Machine`, and a search of the diagnosis over one of its logs."""

from model_files import SMALL_BODY

from fpjax import load_model
from fpjax.gap.verb import make_search

RUN = """
[controller]
type = "unknown"
[simulation]
dt = 1e-3
"""
MODEL = SMALL_BODY + RUN


def search_of(log, model=MODEL):
    return make_search([log], [], load_model(model))

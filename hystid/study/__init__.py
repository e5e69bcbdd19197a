"""Studies of many trainings: which structure, and how much a wrong mass costs. Resumable; here or on a Dask cluster."""

from hystid.study.cells import Cell, GridResult, MassResult, Spread
from hystid.study.studies import DEFAULT_STRUCTURES, grid, mass
from hystid.study.work import Outcome

__all__ = ["DEFAULT_STRUCTURES", "Cell", "GridResult", "MassResult", "Outcome", "Spread", "grid", "mass"]

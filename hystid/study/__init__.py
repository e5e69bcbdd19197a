"""Studies of many trainings: which structure, and how much a wrong mass costs. Resumable; here or on a Dask cluster."""

from hystid.study.cells import GridCell, GridResult, MassResult, Quartiles
from hystid.study.studies import DEFAULT_STRUCTURES, grid, mass
from hystid.study.work import TrainingResult

__all__ = ["DEFAULT_STRUCTURES", "GridCell", "GridResult", "MassResult", "Quartiles", "TrainingResult", "grid", "mass"]

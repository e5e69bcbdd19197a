"""pytest plugin: the fixture ``fmu_regression`` replays the reference results that an FMU carries.

    def test_oscillator(fmu_regression):
        fmu_regression("oscillator.fmu")

takes the FMU beside the test's own file, else in the current folder. It fails when a signal leaves its tolerance
tube, and then writes a picture of the difference beside the test's temporary files. ``pytest --fmu-update`` takes the
new results as reference instead.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from hystid.fmu.regress import RegressionResult


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add ``--fmu-update``."""
    group = parser.getgroup("hystid")
    group.addoption("--fmu-update", action="store_true", help="take the new FMU results as reference")


@pytest.fixture
def fmu_regression(request: pytest.FixtureRequest, tmp_path: Path) -> Callable[..., RegressionResult]:
    """Callable (path, relative=1e-3, samples=1) -> RegressionResult; fails the test where the FMU answers otherwise."""

    def check(path: Path | str, *, relative: float = 1e-3, samples: int = 1) -> RegressionResult:
        from hystid.fmu.regress import regress  # imported late: the plugin is loaded in every run of pytest

        update = bool(request.config.getoption("--fmu-update"))
        beside = request.path.parent / path  # an absolute path stays what it is
        result = regress(beside if beside.exists() else Path(path), update=update, relative=relative, samples=samples)
        if not result.passed:
            picture = tmp_path / f"{Path(path).stem}_difference.svg"
            picture.write_text(result.picture(), encoding="utf-8")
            pytest.fail(
                f"{result.summary()}\n  picture: {picture}\n  new reference: pytest --fmu-update", pytrace=False
            )
        return result

    return check

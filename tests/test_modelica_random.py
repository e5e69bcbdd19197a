"""The generators of ``Modelica.Math.Random``: published numbers, and C beside Python."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from hystid.compiled import CompiledModel
from hystid.errors import ModelicaError
from hystid.modelica import compile_model
from hystid.modelica.xorshift import GENERATORS, hashed

STATES = {"Xorshift64star": 2, "Xorshift128plus": 4, "Xorshift1024star": 33}


def library(kind: str) -> str:
    """The functions by the names that they have in the standard library; what they do is known to the compiler."""
    return f"""within Modelica.Math;
package Random
  package Generators
    package {kind}
      constant Integer nState = {STATES[kind]};
      function initialState
        input Integer localSeed;
        input Integer globalSeed;
        output Integer state[nState];
      algorithm
        state := fill(localSeed, nState);
      end initialState;
      function random
        input Integer stateIn[nState];
        output Real result;
        output Integer stateOut[nState];
        external "C" some_function(stateIn, stateOut, result);
      end random;
    end {kind};
  end Generators;
  package Utilities
    function automaticLocalSeed
      input String path;
      output Integer seed;
      external "C" seed = some_hash(path);
    end automaticLocalSeed;
    impure function impureRandom
      input Integer id;
      output Real y;
      external "C" y = some_other(id);
    end impureRandom;
  end Utilities;
end Random;
"""


@pytest.fixture
def drawn(tmp_path: Path):
    """drawn(kind, seeds, count): numbers that a compiled model draws, and the last state."""

    def draw(kind: str, seeds: tuple[int, int], count: int) -> tuple[np.ndarray, np.ndarray]:
        folder = tmp_path / "lib" / "Modelica"
        (folder / "Math").mkdir(parents=True, exist_ok=True)
        (folder / "package.mo").write_text("package Modelica\nend Modelica;\n")
        (folder / "Math" / "package.mo").write_text("within Modelica;\npackage Math\nend Math;\n")
        (folder / "Math" / "Random.mo").write_text(library(kind))
        (tmp_path / "A.mo").write_text(f"""
model A
  import generator = Modelica.Math.Random.Generators.{kind};
  parameter Integer seed = {seeds[0]};
  Integer s[generator.nState];
  discrete Real r;
initial equation
  pre(s) = generator.initialState(seed, {seeds[1]});
  r = generator.random(pre(s));
equation
  when sample(0, 1) then
    (r, s) = generator.random(pre(s));
  end when;
end A;
""")
        model = CompiledModel(compile_model(f"{tmp_path / 'A.mo'}:A", libraries=[tmp_path / "lib"]))
        names = [f"s[{k + 1}]" for k in range(STATES[kind])]
        got = model.simulate({}, 1.0, rows=count, outputs=["r", *names])
        return got["r"], np.array([got[n] for n in names])

    return draw


def test_the_numbers_are_the_published_ones(drawn) -> None:
    # Modelica.Blocks.Examples.Noise.UniformNoise, y = -1 + 4 r of uniformNoise2 (MAP-LIB_ReferenceResults, v4.1.0)
    first, _ = drawn("Xorshift128plus", (10, 67867967), 4)
    np.testing.assert_array_equal(-1 + 4 * first[:1], [0.20217088936010374])
    np.testing.assert_allclose(-1 + 4 * first[1:], [0.04551318, 0.48067224, 0.73598713], atol=5e-9)  # as printed there


@pytest.mark.parametrize("kind", STATES)
def test_the_printed_generators_are_those_of_python_to_the_bit(drawn, kind: str) -> None:
    numbers, states = drawn(kind, (-7, 0), 20)
    step, _ = GENERATORS[f"hy_{kind.lower()}"]
    for k in range(19):
        made = step(list(states[:, k]))
        assert made == [numbers[k + 1], *states[:, k + 1]]
    assert np.all((numbers > 0) & (numbers <= 1)) and len(set(numbers)) == 20


@pytest.mark.parametrize("kind", STATES)
def test_numbers_are_even_and_do_not_remember(kind: str) -> None:
    step, size = GENERATORS[f"hy_{kind.lower()}"]
    state: list[float] = [float(k + 1) for k in range(size - size % 2)] + [0.0] * (size % 2)
    numbers = []
    for k in range(4100):
        number, *state = step(state)
        numbers += [number] if k >= 100 else []  # the first ones remember so poor a state
    r = np.array(numbers)
    # of 4000 numbers: five standard deviations of a mean, a variance and a correlation of even ones
    assert abs(r.mean() - 0.5) < 5 * np.sqrt(1 / 12 / 4000)
    assert abs(r.var() - 1 / 12) < 5 * np.sqrt(1 / 180 / 4000)
    assert abs(np.corrcoef(r[1:], r[:-1])[0, 1]) < 5 / np.sqrt(4000)


def test_both_seeds_zero_make_numbers_too(drawn) -> None:
    numbers, _ = drawn("Xorshift64star", (0, 0), 5)
    assert len(set(numbers)) == 5


def test_names_make_seeds_of_32_bits() -> None:
    # by hand, 32 bits: 0xAAAAAAAA ^ (0xAAAAAAAA << 7 ^ 97 * (0xAAAAAAAA >> 3))
    first = 0xAAAAAAAA
    by_hand = (first ^ (first << 7) ^ 97 * (first >> 3)) & 0xFFFFFFFF
    assert hashed("a") == by_hand - (by_hand >> 31 << 32)
    seeds = {hashed(f"Rig.noise{k}") for k in range(1000)}
    assert len(seeds) == 1000 and all(-(2**31) <= s < 2**31 for s in seeds)


def test_a_hidden_state_is_refused(tmp_path: Path, drawn) -> None:
    drawn("Xorshift64star", (1, 1), 2)
    text = (
        "model B discrete Real y; equation when sample(0, 1) then y = Modelica.Math.Random.Utilities.impureRandom(1); "
    )
    (tmp_path / "B.mo").write_text(text + "end when; end B;\n")
    with pytest.raises(ModelicaError, match=r"B\.mo:1: impureRandom\(\) is not supported: it keeps a state"):
        compile_model(f"{tmp_path / 'B.mo'}:B", libraries=[tmp_path / "lib"])


def test_noise_that_takes_its_seed_from_its_name_is_told(
    tmp_path: Path, drawn, caplog: pytest.LogCaptureFixture
) -> None:
    drawn("Xorshift64star", (1, 2), 1)  # writes the library
    (tmp_path / "A.mo").write_text("""
model Noise
  parameter Boolean automatic = true;
  final parameter Integer seed(fixed = false);
initial equation
  seed = if automatic then Modelica.Math.Random.Utilities.automaticLocalSeed(getInstanceName()) else 10;
end Noise;
model A
  Noise named, given(automatic = false);
end A;""")
    model = CompiledModel(compile_model(f"{tmp_path / 'A.mo'}:A", libraries=[tmp_path / "lib"]))
    got = model.simulate({}, 1.0, rows=1, outputs=["named.seed", "given.seed"])
    assert (got["named.seed"][0], got["given.seed"][0]) == (hashed("A.named"), 10)
    assert "from the names A.named, which tools write in different ways" in caplog.text


def test_a_component_may_be_called_sample(tmp_path: Path) -> None:
    (tmp_path / "A.mo").write_text("""
block Ticker
  parameter Real period = 1;
  Boolean b = sample(0, period);
  discrete Integer n(start = 0, fixed = true);
equation
  when sample(0, period) then
    n = pre(n) + 1;
  end when;
end Ticker;
model A
  Ticker sample(period = 0.25);
end A;
""")
    got = CompiledModel(compile_model(f"{tmp_path / 'A.mo'}:A")).simulate({}, 0.1, rows=11, outputs=["sample.n"])
    np.testing.assert_array_equal(got["sample.n"], np.floor(np.arange(11) * 0.4 + 1 + 1e-9))

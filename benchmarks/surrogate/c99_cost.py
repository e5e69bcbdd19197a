"""Cost of one step of the plain C99 surrogate: ARM instructions under qemu, and cycles of this machine.

    python -m benchmarks.surrogate.c99_cost

Instructions are counted, not timed: qemu logs each one, and the difference between runs of 10 and of 60 steps holds the
steps alone. Cycles are those of the time-stamp counter (x86 only), the least of many runs.
"""

from __future__ import annotations

import platform
import shutil
import subprocess
import tempfile
from pathlib import Path

from benchmarks.surrogate.step_cost import ensemble
from hystid.networks import onnx as exchange
from hystid.surrogate import c_source

STRICT = ["-std=c99", "-Wall", "-Wextra", "-Wpedantic", "-Werror", "-O2"]
ARM = "arm-linux-gnueabihf-gcc"
SHORT, LONG = 10, 60  # steps of the two runs under qemu
SIZES = ((1, (5, 5)), (3, (5, 5)), (3, (13, 13, 13)))
MAIN = """\
#include <stdio.h>
#include <stdlib.h>
#include "joint.h"
{clock}
int main(int argc, char **argv)
{{
    joint_state state;
    joint_inputs in;
    joint_outputs out;
    int k, n = argc > 1 ? atoi(argv[1]) : 1;
    unsigned long long begun;
    joint_start(&state);
    begun = CLOCK;
    for (k = 0; k < n; ++k) {{
        in.x = ({real})((k % 64) - 32) / 64;
        in.v = (k % 64) < 32 ? 1 : -1;
        joint_step(&state, &in, &out);
    }}
    printf("%llu %g\\n", CLOCK - begun, (double)out.R);
    return 0;
}}
"""


def compiled(folder: Path, chain: str, real: str) -> Path:
    """A program that steps as often as its argument says and prints the cycles that this took."""
    counts = chain == "cc" and platform.machine() == "x86_64"
    clock = "#include <x86intrin.h>\n#define CLOCK __rdtsc()" if counts else "#define CLOCK 0ull"
    (folder / "main.c").write_text(MAIN.format(clock=clock, real=real))
    strict = [flag for flag in STRICT if not (counts and flag in ("-std=c99", "-Wpedantic"))]  # the counter is no C99
    for source, flags in (("joint.c", STRICT), ("main.c", strict)):
        subprocess.run([chain, *flags, "-c", source], check=True, cwd=folder)
    program = folder / f"main_{chain}"
    link = [chain, "joint.o", "main.o", "-lm", "-o", str(program), *(["-static"] if chain == ARM else [])]
    subprocess.run(link, check=True, cwd=folder)
    return program


def instructions(program: Path, steps: int) -> int:
    """Instructions of a whole run: one line of qemu's log each."""
    log = program.with_suffix(".log")
    subprocess.run(
        ["qemu-arm", "-singlestep", "-d", "exec,nochain", "-D", str(log), str(program), str(steps)],
        check=True,
        stdout=subprocess.DEVNULL,
    )
    with log.open("rb") as lines:
        return sum(1 for _ in lines)


def cycles(program: Path, steps: int = 100_000, runs: int = 9) -> float:
    """Cycles of one step, the least of several runs."""
    answers = (subprocess.run([str(program), str(steps)], capture_output=True, check=True).stdout for _ in range(runs))
    return min(int(answer.split()[0]) for answer in answers) / steps


def main() -> None:
    """Print the table."""
    armed = shutil.which(ARM) is not None and shutil.which("qemu-arm") is not None
    print("| surrogate | ARM instructions per step | x86-64 cycles per step | state [B] |\n|---|---|---|---|")
    for members, sizes in SIZES:
        for real, width in (("double", 8), ("float", 4)):
            with tempfile.TemporaryDirectory() as name:
                folder = Path(name)
                exchange.write(ensemble(members, sizes), folder / "joint.onnx")
                for file, text in c_source(folder / "joint.onnx", name="joint", real=real).items():
                    (folder / file).write_text(text)
                states = int((folder / "joint.h").read_text().split("JOINT_STATES ")[1].split()[0])
                arm = "not measured"
                if armed:
                    program = compiled(folder, ARM, real)
                    arm = f"{(instructions(program, LONG) - instructions(program, SHORT)) / (LONG - SHORT):.0f}"
                here = "not measured"
                if platform.machine() == "x86_64":
                    here = f"{cycles(compiled(folder, 'cc', real)):.0f}"
            label = f"{members} x {'-'.join(map(str, sizes))}, {real}"
            print(f"| {label} | {arm} | {here} | {states * width} |", flush=True)


if __name__ == "__main__":
    main()

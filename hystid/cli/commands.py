"""The sub-commands. Each reads its options, makes one library call, writes the report and prints a summary."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

from hystid.cli import groups
from hystid.cli import options as opt
from hystid.errors import UsageError, printable
from hystid.outputs import check_file

app = typer.Typer(
    name="hystid",
    help="Identify, export, validate and diagnose structures that slide, stick, open and close.\n\n"
    "m a + R = F, SI units; R opposes motion as a spring does. Every command has examples in its own --help.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"]},
)


def _version(asked: bool) -> None:
    if asked:
        from importlib.metadata import version

        print(f"hystid {version('hystid')}")
        raise typer.Exit


@app.callback()
def _common(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version and exit.")
    ] = False,
) -> None:
    pass


Output = Annotated[
    Path, typer.Option("-o", "--out", parser=opt.named, metavar="FILE", help="File to write.", show_default=False)
]
Force = Annotated[
    str,
    typer.Option(
        metavar="SPEC|REC",
        help="chirp:0-100Hz@60N,5s | harmonic:20Hz@80N,2s | multisine:5-80Hz@30Nrms,4s, or a recording.",
        show_default=False,
    ),
]
Step = Annotated[
    float | None,
    typer.Option("--dt", metavar="S", help="Time step in s of a force given as SPEC; 1e-4 where none is given."),
]


@app.command()
@groups.grouped
def build(
    model: Annotated[
        str, typer.Argument(metavar="MODEL", help="HystId.Oscillators.Jenkins, file.mo[:Class], or net.onnx.")
    ],
    out: Output,
    target: Annotated[
        str, typer.Option(metavar="fmu|c", help="An FMU, or one C99 header and source of a network's step.")
    ] = "fmu",
    real: Annotated[str, typer.Option(metavar="double|float", help="Number type of --target c.")] = "double",
    *,
    fmu: groups.FmuOptions,
) -> None:
    """Compile a Modelica model, or an ONNX network, to an FMU.

    An FMU that is replaced hands its reference result on: what changed is printed, and hystid regress fails until
    --update accepts it.

    \b
    Examples:
      hystid build HystId.Oscillators.Jenkins --set m=4.2 --set Ks=2e5 -o jenkins.fmu
      hystid build my.mo:Rig --fmi 3 --platforms all -o rig.fmu
      hystid build Modelica.Mechanics.Translational.Examples.Oscillator --library msl/ -o oscillator.fmu
      hystid build surrogate.onnx -o force.fmu
      hystid build surrogate.onnx --target c -o force.c
      hystid build net.onnx --fmi 3 --arrays -o net.fmu
    """
    from hystid import building

    if opt.choice("--target", target, ("fmu", "c")) == "c":
        if unused := fmu.given():
            raise UsageError(f"{unused[0]}: only FMUs have it, and --target c writes none; leave it out")
        _build_c(Path(model), out, opt.choice("--real", real, ("double", "float")))
        return
    if real != "double":
        raise UsageError(f"--real {real}: FMUs hold double numbers; give it with --target c")
    if fmu.fmi != 2 and fmu.fmi != 3:
        raise UsageError(f"--fmi {fmu.fmi}: FMI versions 2 and 3 are written")
    platforms = opt.choice("--platforms", fmu.platforms, ("host", "all"))
    check_file(out, ".fmu")
    version: Literal[2, 3] = 2 if fmu.fmi == 2 else 3
    values, libraries = opt.numbers("--set", fmu.set_), fmu.library or ()
    if fmu.arrays:
        if fmu.fmi != 3 or not model.lower().endswith(".onnx") or values or libraries:
            raise UsageError(
                "--arrays: only networks (.onnx) have them, without --set and --library, and in FMI 3 only"
            )
        made = building.build_arrays(
            Path(model), out, platforms=platforms, about=fmu.about(), new_reference=fmu.new_reference
        )
    else:
        work = building.build_afresh if fmu.new_reference else building.build
        made = work(
            model, out, fmi=version, parameters=values, platforms=platforms, libraries=libraries, about=fmu.about()
        )
    opt.show(f"{made.summary()} from {model}")
    if made.changes is not None:
        opt.show("the reference is still that of the FMU before; changed:")
        for change in made.changes or ["nothing"]:
            print(f"  {printable(change)}")


def _build_c(network: Path, out: Path, real: Literal["double", "float"]) -> None:
    from hystid.files import write_text
    from hystid.surrogate import c_source

    check_file(out, ".c")
    if network.suffix.lower() != ".onnx":
        raise UsageError(f"--target c: {network}: a step in C is made of a network; name an .onnx file")
    for name, text in c_source(network, name=out.stem, real=real).items():
        write_text(out.with_name(name), text)
    opt.show(f"{out} and {out.with_suffix('.h').name} ({real} precision, from {network})")


@app.command()
def simulate(
    fmu: Annotated[Path, typer.Argument(metavar="FMU", help="An FMU with an input F.")],
    force: Force,
    out: Output,
    set_: opt.Set = None,
    dt: Step = None,
    noise_snr: Annotated[float | None, typer.Option(metavar="DB", help="Add white noise at this ratio in dB.")] = None,
    seed: opt.Seed = 0,
) -> None:
    """Drive an FMU with a force and write the answer as a recording (t, F, x, v, a, R in SI units).

    \b
    Examples:
      hystid simulate jenkins.fmu --force chirp:0-100Hz@60N,5s --noise-snr 34 -o chirp60.csv
      hystid simulate jenkins.fmu --force measured.csv --set Ks=1.8e5 -o answer.csv
    """
    from hystid.excitation import is_specification
    from hystid.recording import write_csv
    from hystid.simulation import force_of, simulate

    check_file(out, ".csv")
    if dt is not None and not is_specification(force) and Path(force).exists():
        raise UsageError(f"--dt {dt:g}: {force} is a recording and has a time step of its own; leave --dt out")
    record = simulate(
        fmu,
        force_of(force, 1e-4 if dt is None else dt, seed),
        parameters=opt.numbers("--set", set_),
        noise_snr=noise_snr,
        seed=seed,
    )
    write_csv(record, out)
    if set_:  # in the units of the FMU, which may be others than somebody thought
        opt.show(next(note for note in reversed(record.notes) if note.startswith("simulated with")))
    opt.show(f"{out} ({len(record)} samples at {record.sample_rate:.6g} Hz)")


@app.command()
@groups.grouped
def check(
    recordings: opt.Recordings,
    mass: Annotated[float | None, typer.Option(metavar="KG", help="Moving mass in kg, where it is known.")] = None,
    out: Annotated[
        Path | None, typer.Option("-o", "--out", parser=opt.named, metavar="DIR", help="Folder for the report.")
    ] = None,
    *,
    reading: groups.ReadingOptions,
) -> int:
    """Say what is in recordings, and whether their channels fit together: units, signs, clocks, columns, mass.

    Exit code 0: nothing speaks against using them; 1: something has to be mended first, and the answer says how.

    \b
    Examples:
      hystid check sweep*.csv --mass 4.2 -o check
      hystid check logger.csv --unit a=g --reverse F
    """
    from hystid.consistency import check
    from hystid.files import write_json

    rules = {*(reading.accept or ()), "missing_force"}
    result = check(reading.load(recordings, rules), mass, rules)
    if out is not None:
        with opt.results(out) as folder:
            write_json(folder / "check.json", result.as_dict())
            result.report(folder / "report.html", opt.command_line("check"))
        opt.done(result, out)
    else:
        opt.show(result.summary())
    return 1 if result.refusals else 0


@app.command()
@groups.grouped
def identify(
    recordings: opt.Recordings,
    mass: opt.Masses,
    out: opt.Folder,
    holdout: opt.Holdout = None,
    model: Annotated[
        str | None,
        typer.Option(
            metavar="MODEL", help="Physics to fit together with networks: file.mo:Class, a class, or DIR of diagnose."
        ),
    ] = None,
    *,
    training: groups.TrainingOptions,
    reading: groups.Preparation,
) -> int:
    """Train a network model of the restoring force and write it as ONNX and FMU, with a report.

    Exit code 0: the model can be used; 1: it is worse than a linear fit, or than no model at all in closed loop.

    \b
    Examples:
      hystid identify chirp*.csv --mass 4.2 --layers 5,5 --ensemble 30 --holdout sine20.csv -o model
      hystid identify damper.csv --mass 0 --band 0-50Hz --decimate 4 -o model
      hystid identify mr1.csv mr2.csv --mass 0 --input current --holdout mr3.csv -o model
      hystid identify b20.csv b80.csv --mass 0 --input tension=20lbf,80lbf -o model
      hystid identify light.csv heavy.csv --mass 4.2,6.1 -o model
      hystid identify chirp*.csv --mass 4.2 --model why --holdout sine20.csv -o model
    """
    from hystid import identification

    with opt.results(out) as folder:
        unseen = opt.apart(recordings, holdout)
        kilograms, loaded = opt.with_masses(mass, reading.load(recordings), reading.load(unseen))
        inputs, (used, held) = opt.with_inputs(reading.further, *loaded)
        result = identification.identify(
            used,
            mass=kilograms,
            band=opt.band_of(reading.band),
            decimate=reading.decimate,
            holdout=held,
            inputs=inputs,
            model=model,
            out=folder,
            **training.settings(),
        )
        result.report(folder / "report.html", opt.command_line("identify"))
    opt.done(result, out)
    if result.failure:
        print(f"this model is of no use: {result.failure}")
    return 1 if result.failure else 0


@app.command()
@groups.grouped
def validate(
    surrogate: Annotated[Path, typer.Argument(metavar="SURROGATE", help="surrogate.fmu, oscillator.fmu or .onnx.")],
    out: opt.Folder,
    recordings: Annotated[
        list[Path] | None, typer.Argument(metavar="[REC...]", help="Recordings to compare with.")
    ] = None,
    mass: Annotated[
        float | None, typer.Option(metavar="KG", help="Moving mass in kg, if not that of the model.")
    ] = None,
    *,
    reference: groups.Reference,
    reading: groups.Preparation,
) -> None:
    """Compare a surrogate with recordings or with a reference FMU, in closed loop with its mass.

    \b
    Examples:
      hystid validate model/surrogate.fmu sine20.csv sine50.csv -o check
      hystid validate model/surrogate.fmu --against jenkins.fmu --force harmonic:20Hz@80N,2s -o check
    """
    from hystid import validation

    if bool(recordings) == bool(reference.against):
        raise UsageError(
            "name either recordings or a reference FMU (--against REF.fmu with --force SPEC) to compare with"
        )
    if reference.against and not reference.force:
        raise UsageError("--against needs at least one --force, as --force harmonic:20Hz@80N,2s")
    _, (loaded,) = opt.with_inputs(reading.further, reading.load(recordings or ()))
    with opt.results(out) as folder:
        result = validation.validate(
            surrogate,
            loaded,
            reference=reference.against,
            forces=tuple(reference.force or ()),
            mass=mass,
            dt=reference.dt,
            band=opt.band_of(reading.band),
            decimate=reading.decimate,
            out=folder,
        )
        result.report(folder / "report.html", opt.command_line("validate"))
    opt.done(result, out)


@app.command()
@groups.grouped
def diagnose(
    recordings: opt.Recordings,
    baseline: groups.BaselineModel,
    out: opt.Folder,
    holdout: opt.Holdout = None,
    effects: Annotated[
        list[Path] | None,
        typer.Option(metavar="MY.mo", help="Your own effect blocks as further candidates; repeatable."),
    ] = None,
    *,
    reading: groups.ReadingOptions,
) -> int:
    """Find where a model and recordings disagree, name the physics that was left out, and fit it.

    Exit code 0: the model explains the data (perhaps after its own refit); 1: something was found, or a label of a
    recording cannot be right, such as a unit or a sign.

    \b
    Examples:
      hystid diagnose sweep*.csv --model HystId.Oscillators.Jenkins --set m=4.2 --holdout sine30.csv -o why
    """
    from hystid.diagnosis import TOLERATED, diagnose, inputs_missing, not_applicable
    from hystid.errors import RecordingError

    unseen = opt.apart(recordings, holdout)
    known = baseline.known()
    with opt.results(out) as folder:
        try:
            used, held = reading.load(recordings, TOLERATED), reading.load(unseen, TOLERATED)
        except RecordingError as refusal:
            if not inputs_missing(refusal):
                raise
            result = not_applicable(str(refusal), baseline.model, out=folder)
        else:
            with baseline.told(folder):
                result = diagnose(
                    used,
                    model=baseline.taken(folder),
                    parameters=known,
                    holdout=held,
                    effects=tuple(effects or ()),
                    out=folder,
                )
            result = baseline.kept(result, folder, out)
        result.report(folder / "report.html", opt.command_line("diagnose"))
    opt.done(result, out)
    return 0 if result.verdict in ("consistent", "recalibrated") and not result.misread else 1


@app.command()
def regress(
    fmu: Annotated[Path, typer.Argument(metavar="FMU", help="An FMU with a reference result inside or beside it.")],
    update: Annotated[bool, typer.Option("--update", help="Store today's result as the reference.")] = False,
    reference: Annotated[
        Path | None,
        typer.Option(metavar="OLD.fmu|DIR|CSV", help="Compare with the reference of another FMU, a folder or a table."),
    ] = None,
) -> int:
    """Replay the reference result of an FMU and compare; exit code 1 when a signal differs.

    Real numbers must stay in a tolerance tube; integers, enumerations, truth values and texts must be the same.

    \b
    Examples:
      hystid regress jenkins.fmu
      hystid regress jenkins.fmu --reference released/jenkins.fmu
      hystid regress jenkins.fmu --update
    """
    from hystid.files import write_text
    from hystid.fmu import regress

    outcome = regress(fmu, update=update, reference=reference)
    opt.show(outcome.summary())
    if outcome.passed:
        return 0
    picture = fmu.with_name(f"{fmu.stem}_difference.svg")
    write_text(picture, outcome.picture())
    opt.show(f"the difference is drawn in {picture}")
    return 1


@app.command()
def demo(
    out: Annotated[
        Path, typer.Option("-o", "--out", parser=opt.named, metavar="DIR", help="Folder for the results.")
    ] = Path("hystid-demo"),
    strict: Annotated[bool, typer.Option("--strict", help="Exit with 1 when a target is missed.")] = False,
) -> int:
    """Everything on a virtual experiment: Modelica, FMU, identification, validation, diagnosis (under 3 minutes).

    Missed targets are printed and marked in the report; with --strict they also give exit code 1.

    \b
    Examples:
      hystid demo -o hystid-demo
    """
    from dataclasses import replace

    from hystid import virtual_experiment

    with opt.results(out) as folder:
        outcome = replace(virtual_experiment.demo(folder), folder=out)
    opt.show(outcome.summary())
    return 1 if strict and not outcome.passed else 0

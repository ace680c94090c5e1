"""The command line: `spherecal COMMAND`. Exit codes: 0 done, 2 bad input, 3 done but not valid, 130 cancelled."""

import argparse
import io
import logging
import os
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

from spherecal import __version__, interrupts
from spherecal.cli import (
    about,
    ball,
    bars,
    batch,
    bundle,
    check,
    export,
    frame,
    limits,
    network_commands,
    profile,
    session,
    study,
)
from spherecal.cli.cameras_parser import add_parser as add_cameras
from spherecal.cli.parsing import Parser, add_common, is_standard_output, parsers_below, rig_file
from spherecal.errors import Cancelled, OutputError, SpherecalError

DONE, BAD_INPUT, NOT_VALID, CANCELLED = 0, 2, 3, 130

# without --log nothing is logged anywhere: Python's last resort would print each error a second time
logging.getLogger("spherecal").addHandler(logging.NullHandler())


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command and return its exit code; errors are one clear message on standard error."""
    _escape_what_the_terminal_lacks()
    try:
        return _run(arguments)
    except SpherecalError as error:
        logging.getLogger("spherecal").error("%s", error)
        _complain(error)
        return error.exit_code
    except KeyboardInterrupt:
        return _cancelled()
    except BrokenPipeError:  # whoever read our output has had enough
        _drop_output()
        return DONE
    except (OSError, MemoryError) as error:
        logging.getLogger("spherecal").error("%s", error)
        _complain(_in_words(error))
        return BAD_INPUT
    except Exception:
        if interrupts.came():  # packages turn Ctrl-C while they load into errors of their own
            return _cancelled()
        raise


def entry() -> int:
    """Run the command that the process was started with: as `main`, with Ctrl-C and a closed output taken care of."""
    interrupts.begin()
    for name in ("stdout", "stderr"):
        if getattr(sys, name) is None:  # the shell closed it: >&-
            setattr(sys, name, open(os.devnull, "w", encoding="utf-8"))  # noqa: SIM115
    try:
        code = main()
        interrupts.finish()
    except SystemExit as end:  # of the parser
        code = end.code if isinstance(end.code, int) else DONE if end.code is None else BAD_INPUT
    except KeyboardInterrupt:  # between two lines of ours
        code = _cancelled()
    return _flushed(code)


def _flushed(code: int) -> int:
    """The exit code after all output was handed over; whoever closed the other end has had enough."""
    try:
        sys.stdout.flush()
    except BrokenPipeError:
        _drop_output()
    except OSError as error:
        _drop_output()
        _complain(_in_words(error))
        return BAD_INPUT
    return code


def _drop_output() -> None:
    """What is still to be written to standard output goes nowhere, instead of failing again as Python ends."""
    with suppress(OSError, ValueError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _cancelled() -> int:
    _complain(Cancelled())
    return CANCELLED


def _in_words(error: OSError | MemoryError) -> SpherecalError:
    if isinstance(error, MemoryError):
        return OutputError("There is not enough memory for this.", "Close other programs, or use smaller input.")
    where = ", ".join(f"{name:.300}" for name in (error.filename, error.filename2) if isinstance(name, str))
    reason = (error.strerror or str(error) or type(error).__name__).lower()
    return OutputError(f"{where or 'Input or output'}: {reason}.", "Check the name, the permissions and the disk.")


def _escape_what_the_terminal_lacks() -> None:
    """A terminal or pipe of an old encoding shows foreign letters of a path escaped, instead of ending the program."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper) and stream.errors == "strict":
            stream.reconfigure(errors="backslashreplace")


def _run(arguments: Sequence[str] | None) -> int:
    parser = make_parser()
    options = parser.parse_args(arguments)
    if options.log is not None:
        _log_to(options.log)
    if options.command is None:
        return subprocess.call([sys.executable, "-m", "spherecal_gui"])
    if options.command == "help":
        return _help(parser, options.words)
    beside = any(is_standard_output(value) for value in vars(options).values())
    with _speaking(options.verbose, options.quiet, beside):
        logging.getLogger("spherecal").info("spherecal %s: %s", __version__, options.command)
        if options.command == "cameras":
            from spherecal.cli import cameras

            return cameras.run(options)
        from spherecal.cli import commands

        return getattr(commands, options.command.replace("-", "_"))(options)


def _help(parser: argparse.ArgumentParser, words: Sequence[str]) -> int:
    """`spherecal help [COMMAND ...]`: what `--help` prints; an unknown command ends as if it were given."""
    found = {known: one for known, one in parsers_below(parser)}.get(tuple(words))
    if found is None:
        parser.parse_args([*words, "--help"])  # it says which word is not known, and ends the program
    else:
        found.print_help()
    return DONE


@contextmanager
def _speaking(verbose: bool, quiet: bool, beside: bool) -> Iterator[None]:
    """Show the log as it is written, or print nothing but errors and JSON, while a command runs.

    `beside`: what it says goes to standard error, since standard output takes the file.
    """
    from spherecal.cli import commands, progress

    logger, handler, level = logging.getLogger("spherecal"), logging.StreamHandler(sys.stderr), logging.INFO
    handler.setFormatter(logging.Formatter("  %(message)s"))
    handler.addFilter(lambda record: record.levelno < logging.ERROR)  # errors are printed by themselves
    before = logger.level, commands.out.quiet, progress.quiet
    if verbose:
        logger.addHandler(handler)
        logger.setLevel(level)
    if quiet:
        commands.out.quiet = progress.quiet = True
    if beside:
        commands.out.file = sys.stderr
    try:
        yield
    finally:
        if beside:
            commands.out.file = None  # type: ignore[assignment]  # whatever standard output is then
        logger.removeHandler(handler)
        logger.setLevel(before[0])
        commands.out.quiet, progress.quiet = before[1:]


def _complain(error: SpherecalError) -> None:
    with suppress(OSError, ValueError):  # where standard error cannot take it, the exit code says it
        print(f"spherecal: {' '.join(str(error).split())}", file=sys.stderr, flush=True)


def _log_to(path: Path) -> None:
    logging.raiseExceptions = False  # a log that cannot be written, on a full disk, is no reason for a traceback
    try:
        if path.exists() and not (path.is_file() or path.is_char_device()):  # opening a pipe would wait for a reader
            raise OutputError(f"{path}: is no file to log to.", "Name another log file.")
        logging.basicConfig(
            filename=path, level=logging.INFO, format="%(asctime)s %(levelname)s %(message)s", encoding="utf-8"
        )
    except OSError as error:
        raise OutputError(f"{path}: cannot be written ({error.strerror}).", "Name another log file.") from error


def make_parser() -> Parser:
    """The parser of all commands."""
    parser = Parser(
        prog="spherecal",
        description="Calibrate a rig of many cameras with an imperfect ball. Without a command: the window.",
        epilog="Exit codes: 0 done; 2 bad usage or input; 3 done, but the result is not valid; 130 cancelled.",
    )
    parser.add_argument(
        "-V", "--version", action="version", version=f"spherecal {__version__}", help="print the version and end"
    )
    commands = parser.add_subparsers(dest="command", metavar="COMMAND")

    def add(name: str, text: str) -> argparse.ArgumentParser:
        return commands.add_parser(name, help=text, description=text)

    helping = add("help", "Help on a command, as its --help prints it.")
    helping.add_argument("words", nargs="*", metavar="COMMAND", help="such as `calibrate` or `profile save`")

    demo = add("demo", "Calibrate and verify a simulated rig, from end to end.")
    demo.add_argument(
        "-o", "--output", type=Path, default=Path("spherecal-demo"), metavar="DIR",
        help="folder for all its files (default spherecal-demo)",
    )  # fmt: skip

    simulate = add("simulate", "Make a session of a simulated rig with its truth.json.")
    simulate.add_argument(
        "preset",
        help="demo, rigA, rigB, hall24, hall50, hall100, dome24, or any hallN, domeN, wideN (lens of N degrees)",
    )
    simulate.add_argument(
        "-o", "--output", type=Path, required=True, metavar="SESSION", help="the session folder to write"
    )
    simulate.add_argument("--observations-only", action="store_true", help="observations instead of images")
    simulate.add_argument("--seed", type=_seed, default=1, help="another seed, another rig and noise (default 1)")

    targets = add("targets", "The coded targets: machine-readable, or sheets to print.")
    kinds = targets.add_subparsers(dest="kind", required=True, metavar="export|sheet")
    for kind, text in (("export", "Write targets.json."), ("sheet", "Write a PDF to print.")):
        one = kinds.add_parser(kind, help=text, description=text)
        one.add_argument("-o", "--output", type=Path, required=True, metavar="FILE", help="the file to write")
        one.add_argument("--count", type=int, default=200, help="how many targets (default 200)")
        one.add_argument("--first-id", type=int, default=1, metavar="ID", help="the first target's number (default 1)")
        one.add_argument("--size", type=float, default=28.0, metavar="MM", help="edge of a sticker (default 28)")
        one.add_argument(
            "--polarity", choices=("light-on-dark", "dark-on-light"), default="light-on-dark",
            help="of the dots on their ground (default light-on-dark)",
        )  # fmt: skip
        one.add_argument(
            "--measured", type=float, nargs=2, metavar=("H_MM", "V_MM"),
            help="what the sheet's two 100 mm rulers measure after printing (across, down)",
        )  # fmt: skip
        if kind == "sheet":
            one.add_argument(
                "--page", choices=("A4", "Letter", "A3", "A2", "A1", "A0"), default="A4",
                help="paper size (default A4); larger than A4 and Letter for boards",
            )  # fmt: skip
            one.add_argument(
                "--board", metavar="BOARD",
                help="print a calibration board instead: aprilgrid,rows=5,columns=4,pitch_mm=39,marker_mm=30, "
                "charuco, chessboard, circles or asymmetric-circles with the fields of the manual's page on boards",
            )  # fmt: skip

    detect = add("detect", "Find coded targets in images.")
    detect.add_argument("images", nargs="+", metavar="IMAGE", help="PNG, TIFF, JPEG, BMP or PGM files")
    detect.add_argument(
        "--targets", type=Path, required=True, metavar="targets.json", help="the target set to look for"
    )
    detect.add_argument(
        "--csv", type=Path, required=True, metavar="FILE", help="the table to write, a row for each dot"
    )

    calibrate = add("calibrate", "Calibrate the rig of a recorded session.")
    calibrate.add_argument("session", type=Path, metavar="SESSION", help="the session folder, or a support bundle")
    calibrate.add_argument(
        "-o", "--output", type=Path, required=True, metavar="RESULT", help="the result folder to write"
    )
    _add_forms(calibrate)
    calibrate.add_argument("--no-opt", action="store_true", help="none-OPT: the first path that reaches a camera")
    calibrate.add_argument("--dijkstra", action="store_true", help="shortest paths instead of A*")
    calibrate.add_argument("--no-spo", action="store_true", help="none-SPO: no spherical projection (tao2021)")
    _add_lenses(calibrate)
    calibrate.add_argument("--engine", choices=("numba", "numpy"), default="numba", help=argparse.SUPPRESS)
    _add_repairs(calibrate)
    calibrate.add_argument("--seed", type=_seed, default=0, help="of the random choices of triples (default 0)")
    calibrate.add_argument("--json", action="store_true", help="print a summary as JSON")

    verify = add("verify", "Measure reference bars with a calibrated rig.")
    verify.add_argument("session", type=Path, metavar="SESSION", help="the session folder with poses of check bars")
    verify.add_argument(
        "--rig", type=rig_file, required=True, metavar="rig.json", help="the rig, or the folder of its result"
    )
    verify.add_argument(
        "-o", "--output", type=Path, required=True, metavar="RESULT", help="the folder to write into, best the rig's"
    )
    verify.add_argument(
        "--limit", metavar="A+L/K", help="the limit of the length error, A in mm: 0.03+L/20000; decided by ISO 14253-1"
    )
    verify.add_argument("--json", action="store_true", help="print a summary as JSON")

    report = add(
        "report", "Write the report of a result: PDF, HTML, JSON or a Digital Calibration Certificate, by the ending."
    )
    report.add_argument("result", type=Path, metavar="RESULT", help="the result folder")
    report.add_argument(
        "-o", "--output", type=Path, required=True, metavar="report.pdf", help="ending in .pdf, .html, .json or .xml"
    )
    report.add_argument("--session", type=Path, metavar="SESSION", help="the session, for pictures of its images")
    report.add_argument("--page", choices=("A4", "Letter"), default="A4", help="paper size of a PDF (default A4)")
    report.add_argument("--issuer", type=Path, metavar="FILE", help="for a certificate (.xml): who issues it")
    report.add_argument("--language", choices=("en", "de", "zh_CN"), default="en", help="of the report (default: en)")

    for module in (
        ball,
        bars,
        check,
        bundle,
        batch,
        export,
        frame,
        limits,
        profile,
        network_commands,
        session,
        study,
        about,
    ):
        module.add_parsers(add)

    add("doctor", "What this machine has and lacks.")
    add_cameras(commands)
    add_common(parser)
    return parser


def _add_repairs(calibrate: argparse.ArgumentParser) -> None:
    """What `calibrate` leaves out, splits and exchanges, asked or by itself."""
    calibrate.add_argument(
        "--leave-out", action="append", default=[], metavar="WHAT",
        help="camera:C05, placement:P3 or the image C05@P3; may be given again",
    )  # fmt: skip
    calibrate.add_argument(
        "--split", action="append", default=[], metavar="C05@P3",
        help="camera C05 moved before P3: it gets a second pose from there on, which is the rig's",
    )  # fmt: skip
    calibrate.add_argument(
        "--swap", action="append", default=[], metavar="C05,C06[@P3]",
        help="put back the exchanged images of two cameras, everywhere or at one placement",
    )  # fmt: skip
    calibrate.add_argument(
        "--no-repair", action="store_true",
        help="do not leave out wrong images nor split moved cameras by itself, however certain they are",
    )  # fmt: skip


def _add_forms(calibrate: argparse.ArgumentParser) -> None:
    """How `calibrate` takes the ball."""
    calibrate.add_argument(
        "--method", choices=("auto", "tao2021", "free", "soft", "rigid", "board", "bar"),
        default="auto", help="auto: rigid where the data carry it, else soft (a ball that gives way a little) or free",
    )  # fmt: skip
    calibrate.add_argument(
        "--shape-sd", type=float, metavar="MM",
        help="with --method soft: how far dots may be off the ball's shape (standard deviation per coordinate); "
        "estimated from the data unless given",
    )  # fmt: skip
    calibrate.add_argument(
        "--ball", type=Path, metavar="ball.json",
        help="stand on this shape of the ball (`spherecal ball export`): two placements then do; a ball that has "
        "changed is told and its profile not used",
    )  # fmt: skip


def _add_lenses(calibrate: argparse.ArgumentParser) -> None:
    """How `calibrate` takes the lenses."""
    calibrate.add_argument(
        "--intrinsics", choices=("free", "fixed"), default="free",
        help="estimate the lenses, or keep them as the session gives them (default free)",
    )  # fmt: skip
    calibrate.add_argument(
        "--lens", choices=("auto", "brown", "rational", "fisheye"),
        help="the lens model of all cameras instead of the session's; auto: another one where it fits better",
    )  # fmt: skip
    calibrate.add_argument(
        "--own-intrinsics", action="store_true", help="every camera for itself, whatever the session groups"
    )


def _seed(text: str) -> int:
    value = int(text)
    if not 0 <= value < 2**31 - 1:
        raise argparse.ArgumentTypeError("a seed is a whole number from 0 to 2147483646")
    return value


if __name__ == "__main__":
    sys.exit(entry())

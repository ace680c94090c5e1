"""The command line: `spherecal COMMAND`. Exit codes: 0 done, 2 bad input, 3 done but not valid, 130 cancelled."""

import io
import logging
import os
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from importlib.util import find_spec
from pathlib import Path

from spherecal import __version__
from spherecal.base import interrupts
from spherecal.base.errors import Cancelled, MissingPackage, OutputError, SpherecalError, needing, reason
from spherecal.base.messages.catalogue import language
from spherecal.base.messages.values import Phrase
from spherecal.base.working_folder import distrust
from spherecal_app.cli.exit_codes import BAD_INPUT, CANCELLED, DONE
from spherecal_app.cli.options import TABLE, command_of, make_parser, words_of
from spherecal_app.cli.parsing import is_standard_output, parsers_below

# without --log nothing is logged anywhere: Python's last resort would print each error a second time
logging.getLogger("spherecal").addHandler(logging.NullHandler())

# With less, libraries end while they load: numba by a segmentation fault below 0.8 GB, OpenCV by an ImportError.
_LEAST_BYTES = 1 << 30


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command and return its exit code; errors are one clear message on standard error."""
    for stream in (sys.stdout, sys.stderr):  # one of an old encoding shows foreign letters of a path escaped
        if isinstance(stream, io.TextIOWrapper) and stream.errors == "strict":
            stream.reconfigure(errors="backslashreplace")
    with ExitStack() as log:
        try:
            return _run(arguments, log)
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
            if not interrupts.came():  # packages turn Ctrl-C while they load into errors of their own
                raise
            return _cancelled()


def entry() -> int:
    """Run the command that the process was started with: as `main`, with Ctrl-C and a closed output taken care of."""
    interrupts.begin()
    distrust()
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
        return OutputError(Phrase("error-memory"))
    where = ", ".join(f"{name:.300}" for name in (error.filename, error.filename2) if isinstance(name, str))
    why = reason(error) if error.strerror or str(error) else type(error).__name__
    return OutputError(Phrase("error-system", {"where": where or Phrase("input-or-output"), "why": why}))


def _check_address_space() -> None:
    """Refuse to begin where the system gives this process too few addresses (`ulimit -v`)."""
    if os.name == "nt":
        return
    import resource

    allowed = resource.getrlimit(resource.RLIMIT_AS)[0]
    if allowed != resource.RLIM_INFINITY and allowed < _LEAST_BYTES:
        raise OutputError(Phrase("error-address-space", {"allowed": allowed / 2**20, "least": _LEAST_BYTES / 2**20}))


def _run(arguments: Sequence[str] | None, log: ExitStack) -> int:
    """Run the command; `log` closes the log file once errors are in it."""
    parser = make_parser()
    options = parser.parse_args(arguments)
    if options.log is not None:
        log.enter_context(_logged_to(options.log))
    if options.command is None:
        if not getattr(sys, "frozen", False) and find_spec("PySide6") is None:
            raise MissingPackage(Phrase("error-no-window"))
        from spherecal_files.programs import own_program

        return subprocess.call(own_program("spherecal_gui"))
    if options.command == "help":
        # `spherecal help [COMMAND ...]`: what `--help` prints; an unknown command ends as if it were given
        found = {known: one for known, one in parsers_below(parser)}.get(tuple(options.words))
        if found is None:
            parser.parse_args([*options.words, "--help"])  # it says which word is not known, and ends the program
        else:
            found.print_help()
        return DONE
    _check_address_space()
    beside = any(is_standard_output(value) for value in vars(options).values())
    as_json = getattr(options, "json", False)
    with _speaking(options.verbose, options.quiet, as_json, beside):
        logging.getLogger("spherecal").info("spherecal %s: %s", __version__, options.command)
        with needing("matplotlib", Phrase("documents")), needing("typst", Phrase("documents")):
            code = command_of(options)(options)
            from spherecal_app.cli.console import out

            lost, out.lost = out.lost, None
            if lost is None:
                return code
            _complain(OutputError(Phrase("error-output-lost", {"why": reason(lost)}), Phrase("error-output-lost-hint")))
            printed = getattr(options, "json", False) or TABLE["commands"][words_of(options)].get("shows", False)
            return BAD_INPUT if printed else code  # what gives nothing but what it prints has failed


@contextmanager
def _speaking(verbose: bool, quiet: bool, as_json: bool, beside: bool) -> Iterator[None]:
    """Show the log as it is written, or print nothing but errors and JSON, while a command runs.

    `as_json`: no words on standard output, but progress.
    `beside`: what it says goes to standard error, since standard output takes the file.
    """
    # here, since they load rich, which --help does not need
    from spherecal_app.cli import console
    from spherecal_app.cli.console import out

    logger, handler, level = logging.getLogger("spherecal"), logging.StreamHandler(sys.stderr), logging.INFO
    handler.setFormatter(logging.Formatter("  %(message)s"))
    handler.addFilter(lambda record: record.levelno < logging.ERROR)  # errors are printed by themselves
    before = logger.level, out.quiet, console.quiet
    if verbose:
        logger.addHandler(handler)
        logger.setLevel(level)
    if quiet or as_json:
        out.quiet, console.quiet = True, quiet or console.quiet
    if beside:
        out.file = sys.stderr
    try:
        yield
    finally:
        if beside:
            out.file = None  # type: ignore[assignment]  # whatever standard output is then
        logger.removeHandler(handler)
        logger.setLevel(before[0])
        out.quiet, console.quiet = before[1:]


def _complain(error: SpherecalError) -> None:
    with suppress(OSError, ValueError):  # where standard error cannot take it, the exit code says it
        words = " ".join(error.words(language()))
        print(f"spherecal: {' '.join(words.split())}", file=sys.stderr, flush=True)


@contextmanager
def _logged_to(path: Path) -> Iterator[None]:
    logging.raiseExceptions = False  # a log that cannot be written, on a full disk, is no reason for a traceback
    try:
        if path.exists() and not (path.is_file() or path.is_char_device()):  # opening a pipe would wait for a reader
            raise OutputError(Phrase("error-no-log", {"file": path}))
        handler = logging.FileHandler(path, encoding="utf-8")
    except OSError as error:
        raise OutputError(
            Phrase("error-cannot-write", {"file": path, "why": reason(error)}), Phrase("error-name-log")
        ) from error
    handler.setFormatter(logging.Formatter("%(asctime)s %(levelname)s %(message)s"))
    before = logging.root.level
    logging.root.addHandler(handler)
    logging.root.setLevel(logging.INFO)
    try:
        yield
    finally:
        logging.root.setLevel(before)
        logging.root.removeHandler(handler)
        with suppress(OSError):  # on a full disk
            handler.close()


if __name__ == "__main__":
    sys.exit(entry())

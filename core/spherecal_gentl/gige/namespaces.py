"""Network namespaces of our own: made, entered, and gone with the last process that uses them."""

import ctypes
import os
import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager

from spherecal_files.programs import find_program

_NEW_NETWORK = 0x40000000  # CLONE_NEWNET
_OWN = "/proc/thread-self/ns/net"
_TOOLS = {
    "unshare": "util-linux", "setpriv": "util-linux", "nsenter": "util-linux", "ip": "iproute2", "tc": "iproute2",
    "nft": "nftables",
}  # fmt: skip
_PATH = f"{os.environ.get('PATH', '')}:/usr/sbin:/sbin"
_LIMIT_S = 20.0

# where there are no namespaces, any library of Python itself will do: `why_not` says so before it is asked
_libc = ctypes.CDLL(None, use_errno=True) if sys.platform.startswith("linux") else ctypes.pythonapi


class CommandError(Exception):
    """A command that set up the network failed; the text is its own."""


def isolated(command: Sequence[str]) -> list[str]:
    """`command` with a network and process numbers of its own, without root too; all its processes end with it."""
    user = [] if os.geteuid() == 0 else ["--user", "--map-root-user"]
    return ["unshare", *user, "--net", "--pid", "--fork", "--kill-child", *command]


def why_not() -> str | None:
    """Why there can be no namespaces here, None where they work; takes some milliseconds."""
    if not hasattr(_libc, "setns"):
        return "network namespaces are a part of Linux only"
    if missing := sorted({package for tool, package in _TOOLS.items() if find_program(tool, _PATH) is None}):
        return f"needs {', '.join(missing)}: apt install {' '.join(missing)}"
    probe = (
        "ip link add spherecal0 type veth peer name spherecal1 && ip link add spherecal2 type bridge && "
        "nft add table netdev probe"
    )
    environment = os.environ | {"PATH": _PATH}
    try:
        done = subprocess.run(
            isolated(["sh", "-c", probe]), capture_output=True, text=True, timeout=_LIMIT_S, check=False,
            env=environment,
        )  # fmt: skip
    except (OSError, subprocess.TimeoutExpired) as error:
        return str(error)
    return None if done.returncode == 0 else (done.stderr.strip().splitlines() or ["refused"])[-1]


class NetworkNamespace:
    """A network namespace, kept open by this object; only for the thread that made it."""

    def __init__(self, file: int) -> None:
        self.file = file

    @classmethod
    def own(cls) -> "NetworkNamespace":
        """The calling thread's network namespace."""
        return cls(os.open(_OWN, os.O_RDONLY | os.O_CLOEXEC))

    @classmethod
    def new(cls) -> "NetworkNamespace":
        """An empty network namespace, its loopback up."""
        with _elsewhere():
            if _libc.unshare(_NEW_NETWORK) != 0:
                raise CommandError(os.strerror(ctypes.get_errno()))
            made = cls.own()
        made.run("ip link set lo up")
        return made

    @contextmanager
    def entered(self) -> Iterator[None]:
        """The calling thread is in the namespace; sockets made meanwhile stay there."""
        with _elsewhere():
            if _libc.setns(self.file, _NEW_NETWORK) != 0:
                raise CommandError(os.strerror(ctypes.get_errno()))
            yield

    def run(self, command: str, *words: str) -> None:
        """Run a command in the namespace; `words` are arguments that may hold blanks."""
        done = subprocess.run(
            self.inside([*command.split(), *words]), capture_output=True, text=True, timeout=_LIMIT_S, check=False,
            pass_fds=(self.file,), env=os.environ | {"PATH": _PATH},
        )  # fmt: skip
        if done.returncode != 0:
            raise CommandError(f"{' '.join((command, *words))}: {done.stderr.strip() or done.returncode}")

    def inside(self, command: Sequence[str]) -> list[str]:
        """The command that runs `command` in the namespace; its process must inherit `file`."""
        return ["nsenter", f"--net=/proc/self/fd/{self.file}", *command]


@contextmanager
def _elsewhere() -> Iterator[None]:
    home = os.open(_OWN, os.O_RDONLY | os.O_CLOEXEC)
    try:
        yield
    finally:
        back: Callable[[int, int], int] = _libc.setns
        failed = back(home, _NEW_NETWORK) != 0
        os.close(home)
        if failed:
            os._exit(70)  # going on in a wrong network would touch what is not ours

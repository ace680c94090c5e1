"""The Aravis producer walked under sanitizers: `python -m benchmarks.gige_sanitized [address,undefined] [thread]`.

Three simulated GigE cameras: one loses packets, the cable of another is pulled while it streams. Ends with 1 where a
sanitizer has something to say. Needs g++.
"""

import hashlib
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from spherecal_files.cache_folder import cache_folder
from spherecal_gentl.gige.gige_control import GigeCamera, GigeRig
from spherecal_gentl.producer.build_producer import aravis_flags

_HERE = Path(__file__).resolve().parent
_PRODUCER = _HERE.parent / "core/spherecal_gentl/producer"
_CYCLES, _FRAMES = "4", "15"
_PLUGGED_S, _UNPLUGGED_S, _LIMIT_S = 1.0, 2.5, 600.0
# What these libraries keep for the life of a program, and their own locks, which the thread sanitizer does not know.
_KEPT = "".join(f"leak:{name}\n" for name in ("libglib", "libgobject", "libgio", "libusb"))
_OWN_LOCKS = "".join(
    f"called_from_lib:{name}\nrace:{name}\n" for name in ("libaravis-0.8.so", "libglib-2.0.so", "libgobject-2.0.so")
)


def _kept(sanitizers: str) -> Path:
    digest = hashlib.sha256(sanitizers.encode())
    for source in sorted([_HERE / "gentl_walk.cpp", *_PRODUCER.glob("*.h"), *_PRODUCER.glob("*.cpp")]):
        digest.update(source.read_bytes())
    return cache_folder("sanitized") / digest.hexdigest()[:16] / "walk"


def built(sanitizers: str, scratch: Path) -> tuple[Path, dict[str, str]]:
    """The walk built with these sanitizers, and the environment to run it in."""
    program = _kept(sanitizers)
    command = [
        "g++",
        "-std=c++17",
        "-O1",
        "-g",
        "-pthread",
        f"-fsanitize={sanitizers}",
        "-fno-omit-frame-pointer",
        f"-I{_PRODUCER}",
        str(_HERE / "gentl_walk.cpp"),
        str(_PRODUCER / "spherecal_aravis.cpp"),
        "-o",
        str(program),
        *aravis_flags(),
        "-ldl",
    ]
    if not program.exists():  # it takes half a minute
        program.parent.mkdir(parents=True, exist_ok=True)
        subprocess.run(command, check=True)
    for name, text in (("leaks", _KEPT), ("locks", _OWN_LOCKS)):
        (scratch / name).write_text(text, encoding="ascii")
    environment = os.environ | {
        "TSAN_OPTIONS": f"suppressions={scratch / 'locks'} ignore_noninstrumented_modules=1",
        "LSAN_OPTIONS": f"suppressions={scratch / 'leaks'}",
        "UBSAN_OPTIONS": "print_stacktrace=1",
    }
    return program, environment


def walked(sanitizers: str, scratch: Path) -> tuple[int, str, str]:
    """Exit code, last line and complaints of the walk built with these sanitizers."""
    program, environment = built(sanitizers, scratch)
    with GigeRig([GigeCamera(f"GE{i + 1:02d}", 320, 240) for i in range(3)]) as rig:
        rig.fault("loss", "GE02", 1)
        words = rig.inside([str(program), _CYCLES, _FRAMES])
        said, complaints = scratch / "said", scratch / "complaints"
        with said.open("w") as out, complaints.open("w") as err:
            walk = subprocess.Popen(words, env=environment, stdout=out, stderr=err)
            until = time.monotonic() + _LIMIT_S
            while walk.poll() is None and time.monotonic() < until:
                for fault, seconds in (("plug", _PLUGGED_S), ("unplug", _UNPLUGGED_S)):
                    rig.fault(fault, "GE03")
                    time.sleep(seconds)
            if walk.poll() is None:
                walk.kill()
        code = walk.wait()
    last = said.read_text().strip().splitlines()
    return code, last[-1] if last else "", complaints.read_text().strip()


def main() -> int:
    """Walk under each of the sanitizers named."""
    bad = False
    for sanitizers in sys.argv[1:] or ("address,undefined", "thread"):
        with tempfile.TemporaryDirectory(prefix="spherecal-") as scratch:
            code, last, complaints = walked(sanitizers, Path(scratch))
        print(f"{sanitizers}: exit code {code}; {last}\n{complaints}", flush=True)
        bad |= code != 0 or bool(complaints)
    return int(bad)


if __name__ == "__main__":
    sys.exit(main())

"""Wrong recordings of every kind and size: which rigs are wrong and valid, which were repaired, what was blamed."""

import argparse
import json
import sys
import time
from collections import Counter
from dataclasses import asdict, dataclass, field, replace
from typing import Literal

import numpy as np
from threadpoolctl import threadpool_limits

from benchmarks.studies.judged import Judged, calibrated_and_judged, words
from benchmarks.studies.mischief import KINDS, Mischief
from benchmarks.studies.mischief_frames import make_frame_world
from benchmarks.studies.mischief_world import RIGS, make_world
from benchmarks.studies.realistic import ACCUSATIONS
from benchmarks.studies.report import Report
from benchmarks.studies.workers import Job, spread
from benchmarks.studies.wrong_verified import LIMIT_MM, Said, said_of

# The rig, and by what it is calibrated where that is not the ball.
FRAMED = tuple(
    f"{rig}, {method}" for rigs in (("rigA", "random"), ("rigB",)) for method in ("board", "bar") for rig in rigs
)
WORLDS = (*RIGS, *FRAMED)
RUNS = 50
CLEAN = 400
CLEAN_KINDS = ("nothing", "nothing with frames")
FIRST_SEED = 2001
FALSE_ALARM = 0.01

Outcome = Literal[
    "wrong and VALID", "wrong with care", "right, told", "right, not told", "refused, right blame",
    "refused, wrong blame", "refused, no blame", "no result",
]  # fmt: skip
OUTCOMES: tuple[Outcome, ...] = Outcome.__args__  # type: ignore[attr-defined]


@dataclass(frozen=True)
class Row:
    """One recording: what was done, what came out, in words."""

    kind: str
    size: float
    rig: str
    seed: int
    outcome: Outcome
    verdict: str
    worst: str
    findings: str
    accused: tuple[str, ...]
    repaired: bool
    seconds: float
    failure: str = ""
    bad: bool = False
    acceptance: str = ""
    decision: str = ""
    checked: str = ""
    covered: float = float("nan")


def one(kind: str, size: float, rig: str, seed: int) -> Row:
    """One recording with mischief through the production calibration."""
    mischief = next(m for m in KINDS if m.name == kind)
    rng = np.random.default_rng([seed, WORLDS.index(rig), list(KINDS).index(mischief), int(1e6 * abs(size))])
    name, _, method = rig.partition(", ")
    world = make_frame_world(name, method, seed) if method else make_world(rig, seed)
    case = mischief.make(world, size, rng)
    if method:
        case = replace(case, world=None)
    result = calibrated_and_judged(case.session, case.reference, case.settings)
    told = case.blamed(result.findings)
    said = said_of(case, result, np.random.default_rng([seed, 11]))
    said = said or Said(False, "", "", "")
    repaired = any("left-out" in f.code or "split" in f.code or "swapped-back" in f.code for f in result.findings)
    return Row(
        kind,
        size,
        rig,
        seed,
        outcome_of(result, told, kind),
        result.verdict,
        result.worst_words(),
        words(result.findings),
        tuple(sorted(set(result.codes) & ACCUSATIONS)),
        repaired,
        result.processor_s,
        result.failure,
        said.bad,
        said.acceptance,
        said.decision,
        said.checked,
        result.covered,
    )


def outcome_of(result: Judged, told: bool, kind: str) -> Outcome:
    """Where a result belongs. An input that is refused with a message counts as refused."""
    if result.failure and not result.failure.startswith("refused"):
        return "no result"
    if result.verdict == "not-valid":
        accused = set(result.codes) & ACCUSATIONS
        if told:
            return "refused, right blame"
        return "refused, wrong blame" if accused else "refused, no blame"
    if result.wrong:
        within = set(result.wrong_cameras) <= result.affected and not result.lengths_wrong
        if result.verdict == "use-with-care":
            return "right, told" if within and result.affected else "wrong with care"
        return "wrong and VALID"
    return "right, told" if told and kind not in CLEAN_KINDS else "right, not told"


@dataclass
class Cell:
    """The outcomes of a kind and size."""

    mischief: Mischief
    size: float
    rows: list[Row] = field(default_factory=list)

    @property
    def counts(self) -> Counter[str]:
        """Recordings by outcome."""
        return Counter(row.outcome for row in self.rows)

    @property
    def covered(self) -> float:
        """The share of lengths within their U over the results that may be used; NaN without any."""
        return _covered(self.rows)

    @property
    def name(self) -> str:
        """Kind, size and the issue's row."""
        row = f"{self.mischief.row}: " if self.mischief.row else ""
        return f"{row}{self.mischief.name} {self.size:g} {self.mischief.unit}".strip()


def _tasks(
    runs: int, rigs: tuple[str, ...], kinds: tuple[Mischief, ...], clean: int
) -> list[tuple[str, float, str, int]]:
    """So many recordings of each kind, its sizes and the rigs in turn; at least one of each size, and kinds mixed."""
    out: list[tuple[str, float, str, int]] = []
    for i in range(max(runs, *(len(m.sizes) for m in kinds), clean)):
        for mischief in kinds:
            sizes = mischief.sizes
            own = [rig for rig in rigs if (rig.partition(", ")[2] or "ball") in mischief.methods]
            if own and i < (clean if mischief.name in CLEAN_KINDS else max(runs, len(sizes))):
                out.append((mischief.name, sizes[i % len(sizes)], own[i // len(sizes) % len(own)], FIRST_SEED + i))
    return out


def _covered(rows: list[Row]) -> float:
    shares = [r.covered for r in rows if r.verdict != "not-valid" and np.isfinite(r.covered)]
    return float(np.mean(shares)) if shares else float("nan")


def _percent(share: float) -> str:
    return f"{100 * share:.1f}" if np.isfinite(share) else ""


def page_of(rows: list[Row], command: str) -> Report:
    """The page of what was recorded."""
    page = Report("Wrong recordings", command)
    page.text(
        "Recordings with mischief, in sizes from invisible to gross, on rigs A and B, a hall of 12 cameras and random "
        "rigs, by the ball, a board and a waved bar, through the production calibration; noise 0.04 px, perfect "
        "prints. Wrong is a camera's centre or angle or one of 40 lengths beyond 3 times its stated expanded "
        "uncertainty, against the rig as it is after the recording. Told: the right thing is named in a finding. "
        "Rows A to J are those of the issue."
    )
    cells: dict[tuple[str, float], Cell] = {}
    by_name = {m.name: m for m in KINDS}
    for row in sorted(rows, key=lambda r: (list(by_name).index(r.kind), by_name[r.kind].sizes.index(r.size))):
        cells.setdefault((row.kind, row.size), Cell(by_name[row.kind], row.size)).rows.append(row)
    page.heading("Outcomes")
    heads = (
        "mischief",
        "n",
        *(f"**{o}**" if o == "wrong and VALID" else o for o in OUTCOMES),
        "repaired",
        "lengths within U %, if usable",
        "seconds",
    )
    page.table(
        heads,
        [
            (
                c.name,
                len(c.rows),
                *(c.counts[o] or "" for o in OUTCOMES),
                sum(r.repaired for r in c.rows) or "",
                _percent(c.covered),
                f"{np.median([r.seconds for r in c.rows]):.1f}",
            )
            for c in cells.values()
        ],
    )
    total = Counter(row.outcome for row in rows if row.kind not in CLEAN_KINDS)
    page.table(("all mischief", "recordings"), [(o, total[o]) for o in OUTCOMES])
    page.heading("Recordings with nothing done")
    clean = [row for row in rows if row.kind in CLEAN_KINDS]
    alarms: Counter[str] = Counter(code for row in clean for code in row.accused)
    page.table(
        ("accusation", "recordings"), [(c, f"{n} of {len(clean)}") for c, n in alarms.most_common()] or [("none", 0)]
    )
    page.heading("Wrong and usable, and no result")
    bad = [row for row in rows if row.outcome in ("wrong and VALID", "wrong with care", "no result")]
    page.table(
        ("mischief", "rig", "seed", "worst", "findings"),
        [(cells[r.kind, r.size].name, r.rig, r.seed, r.failure or r.worst, r.findings) for r in bad]
        or [("none", *[""] * 4)],
    )
    page.heading("Verified and checked")
    page.text(
        f"The same rigs verified with a check bar in ten poses, limit {LIMIT_MM:g} mm, and checked by one more "
        f"placement of the ball, both recorded by the true rig. A rig is bad where a length is off by more than "
        f"{LIMIT_MM:g} mm and 3 U, or a camera's rays miss by more than 1 mm."
    )
    again = [row for row in rows if row.acceptance]
    words_ = ("pass", "cannot tell", "fail")
    page.table(
        ("rig", "n", "PASS", "cannot tell", "FAIL", "CONSISTENT", "INCONSISTENT", "check OK", "watch", "recalibrate"),
        [
            (
                name,
                len(own),
                *(sum(r.acceptance == w for r in own) for w in words_),
                *(sum(r.decision == w for r in own) for w in ("consistent", "inconsistent")),
                *(sum(r.checked == w for r in own) for w in ("ok", "watch", "recalibrate")),
            )
            for name, own in (("bad", [r for r in again if r.bad]), ("good", [r for r in again if not r.bad]))
        ],
    )
    passed = [r for r in again if r.bad and r.acceptance == "pass"]
    page.table(
        ("bad rig that passed", "rig", "seed", "worst"),
        [(cells[r.kind, r.size].name, r.rig, r.seed, r.worst) for r in passed] or [("none", *[""] * 3)],
    )
    page.heading("Refused with the wrong blame, or none")
    blamed = [row for row in rows if row.outcome in ("refused, wrong blame", "refused, no blame")]
    page.table(
        ("mischief", "rig", "seed", "findings"),
        [(cells[r.kind, r.size].name, r.rig, r.seed, r.failure or r.findings) for r in blamed] or [("none", *[""] * 3)],
    )
    page.heading("Goals")
    wrong = total["wrong and VALID"] + sum(r.outcome == "wrong and VALID" for r in clean)
    page.verdict("wrong and VALID: 0", not wrong, f"{wrong} of {len(rows)}")
    for letter in "FGJ":
        share = _covered([row for row in rows if by_name[row.kind].row == letter])
        page.verdict(f"{letter}, where usable: lengths within U in 95 %", share >= 0.95, f"{_percent(share)} %")
    page.verdict("wrong with care: 0", not total["wrong with care"], str(total["wrong with care"]))
    page.verdict("bad rigs that PASS: 0", not passed, f"{len(passed)} of {sum(r.bad for r in again)}")
    fine = sum(r.bad and r.checked == "ok" for r in again)
    page.verdict("bad rigs that the check calls OK: 0", not fine, f"{fine} of {sum(r.bad for r in again)}")
    most = max(alarms.values(), default=0)
    goal = f"no accusation in more than {100 * FALSE_ALARM:.0f} % of the recordings with nothing done"
    page.verdict(goal, bool(clean) and most <= FALSE_ALARM * len(clean), f"at most {most} of {len(clean)}")
    refused = sum(row.outcome == "refused, right blame" for row in rows)
    every = refused + len(blamed)
    page.verdict("refused with the right blame in at least 90 %", refused >= 0.9 * every, f"{refused} of {every}")
    return page


def report(runs: int | None, rigs: tuple[str, ...] = WORLDS, processes: int | None = None) -> Report:
    """The study's page."""
    runs = runs or RUNS
    clean = CLEAN if runs >= RUNS else max(8, CLEAN * runs // RUNS)
    rows = spread([Job(one, task) for task in _tasks(runs, rigs, KINDS, clean)], processes)
    return page_of(rows, f"dev.py studies wrong --runs {runs}")


def main() -> int:
    """Some cells one after the other, a line each: `--kinds "camera moved" --sizes 3 --rigs rigA --seeds 2001 2002`."""
    parser = argparse.ArgumentParser(prog="benchmarks.studies.wrong", description=__doc__)
    parser.add_argument("--kinds", nargs="+", choices=[m.name for m in KINDS], default=[m.name for m in KINDS])
    parser.add_argument("--sizes", nargs="+", type=float)
    parser.add_argument("--rigs", nargs="+", choices=WORLDS, default=list(RIGS[:1]))
    parser.add_argument("--seeds", nargs="+", type=int, default=[FIRST_SEED])
    parser.add_argument("--turns", action="store_true", help="each size once, rigs in turn")
    parser.add_argument("--json", help="file that every row is appended to")
    options = parser.parse_args()
    kinds = tuple(m for m in KINDS if m.name in options.kinds)
    if options.turns:
        tasks = _tasks(1, tuple(options.rigs), kinds, 8)
    else:
        tasks = [
            (m.name, size, rig, seed)
            for m in kinds
            for size in (options.sizes or m.sizes)
            for rig in options.rigs
            if (rig.partition(", ")[2] or "ball") in m.methods
            for seed in options.seeds
        ]
    begin = time.monotonic()
    for task in tasks:
        with threadpool_limits(1):
            row = one(*task)
        print(f"{time.monotonic() - begin:5.0f} s  {row.kind} {row.size:g} {row.rig} {row.seed}: {row.outcome}", end="")
        print(f" [{row.failure or row.worst}] {row.findings}", flush=True)
        if options.json:
            with open(options.json, "a", encoding="utf-8") as file:
                file.write(json.dumps(asdict(row)) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())

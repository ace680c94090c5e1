"""Tables of reference bars: forgiving reading, every bad line named, nothing lost; balls and benches beside them."""

import json
from pathlib import Path

import numpy as np
import pytest

from spherecal.base.errors import InputError
from spherecal.base.messages.catalogue import phrase
from spherecal.data.session import BarLength, Certificate, Mark
from spherecal.targets.family import make_target_set
from spherecal_app.cli.main import main
from spherecal_cameras.plan import check_marks, read_plan
from spherecal_files.bar_registry import BAR_REGISTRY, RegisteredBar, find_bar
from spherecal_rigs.ball_registry import (
    BALL_REGISTRY,
    Bench,
    BenchBar,
    PrintedSpacing,
    RegisteredBall,
    longest_spacing,
    print_error,
    whole_bar,
    write_bench,
)
from spherecal_rigs.bars_table import arrivals, bars_table, read_bars_table, write_bars_table

HEADING = "serial,from,from_target,to,to_target,length [mm],uncertainty [mm],k"


@pytest.fixture
def registry(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    path = tmp_path / "settings" / "bars.json"
    monkeypatch.setenv("SPHERECAL_BARS", str(path))
    return path


def table(folder: Path, text: str | bytes) -> Path:
    path = folder / "bars.csv"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


def said(path: Path) -> list[str]:
    return [f"{one.serial}: {phrase(one.message)}" for one in read_bars_table(path).problems]


def test_a_plain_table(tmp_path: Path) -> None:
    (bar,) = read_bars_table(table(tmp_path, f"{HEADING}\nB-1,A1,201,A2,202:E,500.012,0.004,2\n")).bars
    assert bar.marks == {"A1": Mark(201, "centre"), "A2": Mark(202, "E")}
    assert bar.lengths == (BarLength("A1", "A2", 500.012, 0.004, 2.0),)
    assert bar.assumed == ("expansion_per_kelvin", "reference_temperature_c") and bar.certificate is None


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "cp1252"])
def test_a_table_as_a_german_spreadsheet_writes_it(tmp_path: Path, encoding: str) -> None:
    text = (
        "# Stäbe der Halle 3\r\n\r\n"
        "Stab;Beschreibung;Von;Ziel 1;Bis;Ziel 2;Nennmaß [mm];Länge (mm);U [µm];k;Ausdehnung [10^-6/K];"
        "Bezugstemperatur;Kalibrierschein;Labor;Datum;Gültig bis;Raum\r\n"
        "17;Stahl, lang;A1;201;A2;202;1000;1.000,0123;4,5;2;11,5;20;K-5;DAkkS-Labor;15.01.2026;15.01.2028;12\r\n"
        ";;A1;201;A3;203;500;500,004;4;;;;;;;;\r\n;;;;;;;;;;;;;;;;\r\n"
    )
    read = read_bars_table(table(tmp_path, text.encode(encoding)))
    assert read.problems == () and read.ignored == ("Raum",)
    (bar,) = read.bars
    assert [(one.length_mm, one.nominal_mm) for one in bar.lengths] == [(1000.0123, 1000), (500.004, 500)]
    assert [one.expanded_uncertainty_mm for one in bar.lengths] == pytest.approx([0.0045, 0.004])
    assert bar.expansion_per_kelvin == pytest.approx(1.15e-5) and bar.description == "Stahl, lang"
    assert bar.certificate is not None and str(bar.certificate.valid_until) == "2028-01-15"


def test_a_chinese_table(tmp_path: Path) -> None:
    text = "编号,标志1,标志2,长度(mm),不确定度(mm)\nB-9,201,202,500.012,0.004\n"
    for encoding in ("utf-8", "gb18030"):
        (bar,) = read_bars_table(table(tmp_path, text.encode(encoding))).bars
        assert (bar.serial, bar.lengths[0].from_mark, bar.lengths[0].length_mm) == ("B-9", "T201", 500.012)


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("B-1,A1,201,A2,202,abc,0.004,2", 'B-1: Line 2, "length [mm]": must be a number, but is "abc".'),
        ("B-1,A1,201,A2,202,,0.004,2", 'B-1: Line 2, "length [mm]": is empty.'),
        ("B-1,A1,,A2,202,500,0.004,2", 'B-1: Line 2, "from_target": is empty.'),
        ("B-1,A1,x7,A2,202,500,0.004,2", "must be the number of a sticker"),
        ("B-1,A1,201,A1,202,500,0.004,2", "gives mark A1 a different sticker than before (201)"),
        ("B-1,A1,201,A1,201,500,0.004,2", "the same mark"),
        ("B-1,A1,201,A2,202,500,40,2", 'B-1: Line 2, "uncertainty [mm]": must be from 0 to 25'),
        ("B-1,A1,201,A2,202,-500,0.004,2", 'B-1: Line 2, "length [mm]": must be'),
        ("B-1,A1,201,A2,202,500,0.004,99", 'B-1: Line 2, "k": must be from 1 to 14'),
        ("B-1,A1,201,A2,202,500,0.004,2,9,9", "has 10 cells, not 8 like the first line"),
        (",A1,201,A2,202,500,0.004,2", ': Line 2, "serial": is empty.'),
        ('"B/1",A1,201,A2,202,500,0.004,2', 'B/1: Line 2, "serial": '),
        ("B-1,A1,201,A2,202,1e400,0.004,2", "must be a number"),
    ],
)
def test_a_bad_line_costs_its_own_bar_only(tmp_path: Path, line: str, message: str) -> None:
    path = table(tmp_path, f"{HEADING}\n{line}\nB-2,A1,203,A2,204,500.1,0.004,2\n")
    assert len(said(path)) == 1 and message in said(path)[0]
    assert [bar.serial for bar in read_bars_table(path).bars] == ["B-2"]


def test_lines_of_one_bar_must_agree_and_dates_must_be_clear(tmp_path: Path) -> None:
    heading = f"{HEADING},certificate,date,valid_until"
    lines = [
        "B-1,A1,201,A2,202,500,0.004,2,K-1,2026-01-15,2028-01-15", "B-1,A1,201,A3,203,900,0.004,2,K-2,,",
        "B-2,A1,201,A2,202,500,0.004,2,K-1,03/04/2026,", "B-3,A1,201,A2,202,500,0.004,2,K-1,25/04/2026,",
        "B-4,A1,201,A2,202,500,0.004,2,K-1,2026-01-15,2025-01-15", "B-5,A1,201,A2,202,500,0.004,2,,2026-01-15,",
    ]  # fmt: skip
    path = table(tmp_path, "\n".join([heading, *lines]))
    assert [bar.serial for bar in read_bars_table(path).bars] == ["B-3"]
    assert said(path) == [
        'B-1: Line 3, "certificate": differs from line 2, which is about the same bar.',
        'B-2: Line 4, "date": must be a date such as 2026-11-21, but is "03/04/2026".',
        'B-4: Line 6, "valid_until": is before the certificate\'s date, 2026-01-15.',
        'B-5: Line 7, "certificate": is empty.',
    ]


@pytest.mark.parametrize(
    ("data", "code"),
    [
        (b"", "error-bars-table-empty"),
        (b"\n\n", "error-bars-table-empty"),
        (b"PK\x03\x04xlsx", "error-bars-table-workbook"),
        (b"serial,length\nB,5\n", "error-bars-table-columns"),
        (b"\x00\x01\x02", "error-bars-table-letters"),
        (b"serial,bar,length,target1,target2\n", "error-bars-table-twice"),
        (HEADING.encode() + b'\n"' + b"x" * 200_000, "error-bars-table"),
        (HEADING.encode() + b"\nB" * 20_001, "error-bars-table-long"),
    ],
)
def test_what_is_no_table_is_said(tmp_path: Path, data: bytes, code: str) -> None:
    with pytest.raises(InputError) as error:
        read_bars_table(table(tmp_path, data))
    assert error.value.code == code and "bars.csv" in str(error.value)


def test_noise_is_refused_or_named_and_never_crashes(tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    good = f"{HEADING}\nB-1,A1,201,A2,202,500.012,0.004,2\n".encode()
    whole = 0
    for _ in range(200):
        data = bytearray(good)
        for place in rng.integers(0, len(data), 4).tolist():
            data[place] = int(rng.choice(list(b'",;\n\t0-eX\xff\x00:.')))
        try:
            whole += bool(read_bars_table(table(tmp_path, bytes(data))).bars)
        except InputError:
            continue
    assert whole < 200


def test_what_is_exported_is_read_back(tmp_path: Path) -> None:
    from datetime import date

    bars = (
        RegisteredBar(
            "B-1",
            {"A1": Mark(201, "centre"), "A2": Mark(202, "E"), "A3": Mark(203, "centre")},
            (BarLength("A1", "A2", 500.0123456, 0.0041, 2.1, 500.0), BarLength("A2", "A3", 123.4, 0.002)),
            2.3e-5,
            19.5,
            'long "one", Ø 20; ähnlich',
            Certificate("K-1", "lab, the", date(2026, 1, 2), date(2027, 1, 2)),
        ),
        RegisteredBar(
            "17", {"T1": Mark(1, "centre"), "T2": Mark(2, "centre")}, (BarLength("T1", "T2", 1e3, 0.01),), 0.0
        ),
    )
    path = tmp_path / "out.csv"
    write_bars_table(bars, path)
    read = read_bars_table(path)
    assert read.bars == bars and read.problems == ()
    assert bars_table(read.bars) == bars_table(bars)


def test_the_command_enters_what_is_good_and_loses_nothing(
    registry: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    first = table(tmp_path, f"{HEADING}\nB-1,A1,201,A2,202,500.012,0.004,2\nB-2,A1,203,A2,204,400,0.004,2\n")
    assert main(["bars", "import", str(first)]) == 0
    assert "2 bars entered" in capsys.readouterr().out
    again = (
        f"{HEADING}\nB-1,A1,201,A2,202,500.013,0.004,2\nB-2,A1,203,A2,204,400,0.004,2\nB-3,A1,x,A2,204,400,0.004,2\n"
    )
    second = table(tmp_path, again)
    assert main(["bars", "import", str(second)]) == 3
    out = capsys.readouterr().out
    assert "B-1: not entered, the registry has other figures" in out and "B-2: as it was" in out and "Line 4" in out
    assert find_bar("B-1").lengths[0].length_mm == 500.012 and set(BAR_REGISTRY.read()) == {"B-1", "B-2"}
    assert main(["bars", "import", str(second), "--replace"]) == 3
    assert find_bar("B-1").lengths[0].length_mm == 500.013
    assert main(["bars", "export", str(tmp_path / "all.csv")]) == 0
    known = BAR_REGISTRY.read()
    found = arrivals(read_bars_table(tmp_path / "all.csv"), known)
    assert {bar.serial for bar in found.same} == set(known) and not found.new and not found.other


# --- balls and benches -----------------------------------------------------------------------------------------------


def test_balls_are_read_back_and_the_print_is_judged(tmp_path: Path) -> None:
    targets = make_target_set(208)
    assert longest_spacing(targets) == ("A", "E", pytest.approx(28.2843, abs=1e-4))
    spacing = PrintedSpacing("A", "E", 28.0)
    assert print_error(targets, spacing) == pytest.approx(-0.01005, abs=1e-5)
    assert print_error(targets, PrintedSpacing("A", "Z", 28.0)) is None
    balls = {
        "big": RegisteredBall("big", 500.0, targets, spacing),
        "small": RegisteredBall("small", 120.0, make_target_set(8)),
    }
    BALL_REGISTRY.write(balls, tmp_path / "balls.json")
    assert BALL_REGISTRY.read(tmp_path / "balls.json") == balls and BALL_REGISTRY.read(tmp_path / "none.json") == {}
    (tmp_path / "balls.json").write_text('{"format": "spherecal/balls", "version": 1, "balls": [{"name": "x"}]}')
    with pytest.raises(InputError, match=r"balls\.json"):
        BALL_REGISTRY.read(tmp_path / "balls.json")


def test_a_bench_is_read_as_a_plan_and_follows_the_registry(registry: Path, tmp_path: Path) -> None:
    marks = {"A1": Mark(201, "centre"), "A2": Mark(202, "centre")}
    bar = RegisteredBar("B-1", marks, (BarLength("A1", "A2", 500.012, 0.004),), 1.15e-5, certificate=Certificate("K"))
    BAR_REGISTRY.write({"B-1": bar})
    ball = RegisteredBall("big", 500.0, make_target_set(208), PrintedSpacing("A", "E", 28.2))
    path = write_bench(Bench(ball, (BenchBar("A", "B-1", "check", 3),), 5, 21.5), tmp_path / "bench")
    plan = read_plan(path)
    check_marks(plan, path)
    assert [one.id for one in plan.sets] == ["P1", "P2", "P3", "P4", "P5", "A-01", "A-02", "A-03"]
    assert plan.sets[-1].temperature_c == 21.5 and plan.target_set == ball.target_set
    assert plan.fields["scale"]["distance_mm"] == 28.2 and plan.bars[0].lengths == bar.lengths
    kept = whole_bar(plan.bars[0])
    assert kept["lengths"][0]["length_mm"] == 500.012 and kept["certificate"] == {"number": "K"}
    scaled = write_bench(Bench(ball, (BenchBar("A", "B-1", "scale", 2),)), tmp_path / "bench")
    assert json.loads(scaled.read_text())["scale"] == {"kind": "bar", "bar": "A"}

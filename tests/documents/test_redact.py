"""Names in support bundles: random logs in three languages, of Windows and Linux, and documents and tables beside."""

import json
import random
import re
import zipfile
from collections.abc import Mapping
from pathlib import Path

import pytest
from conftest import ROOT

from spherecal_app.cli.main import main
from spherecal_documents.support.redact import KINDS, WORDS, Redactor
from tests.example_session import make_session

FIRST = ["Anna", "JÜRGEN", "Marie-Luise", "Wei", "Tomasz", "Zoë", "hans", "OLGA", "Brown", "Chloé"]
LAST = ["Schmidt", "MÜLLER", "O'Neill", "Kowalski", "von Berg", "nakamura", "Zhang", "Lindqvist", "García"]
CHINESE = ["张伟", "王秀英", "欧阳娜娜", "李强"]
HOSTS = ["LAB-PC7", "DESKTOP-8KQ2T1V", "mess-rechner-3", "NAS01", "vision2.firma.local", "WIN-QJ4"]
# Where a name stands when it is met for the first time, and what must be left of the line.
LINES = {
    "home": [
        "opened {windows}\\rigs\\7\\session.json", "2026-11-26 13:00:01,123 INFO reading {linux}/rigs/7 (12 cameras)",
        'File "{windows}\\spherecal\\run.py", line 12, in <module>', "cannot write '/data/users/{account}/out.pdf'",
        "缓存位于 {windows}\\AppData\\Local", "Datei {linux}/messung/P1.png fehlt", "USERPROFILE={windows}\\",
        "file:///C:/Users/{encoded}/x.html", "/run/media/{account}/STICK/session", "{windows_escaped}\\\\AppData",
    ],
    "person": [
        "operator: {person}", "operator={person}, 3 cameras", "Bediener: {person}", "Prüfer: {person}; Kugel 2",
        "操作员\uff1a{chinese}\uff0c3台相机", "用户名: {chinese}", "calibrated by: {person}",
        '{{"operator": "{person}", "n": 3}}',
        "USERNAME={account}", "LOGNAME={account}", "mail to {account}@firma-{number}.de",
        "{account}@{host}:~$ spherecal",
        "ssh://{account}:{token}@{host}:22/x", "https://{account}@{host}/git",
    ],
    "host": [
        "COMPUTERNAME={host}", "hostname: {host}", "Rechner: {host}", "主机名\uff1a{host}",
        "\\\\{host}\\share\\7\\x.csv", "mounted smb://{host}/daten",
        "Nov 26 13:00:01 {host} spherecal[812]: ready", "USERDOMAIN={host}",
    ],
    "serial": [
        "S/N {serial}", "S/N: {serial} opened", "SN={serial}", "serial number {serial} lost", "Seriennummer: {serial}",
        "序列号\uff1a{serial}", "Serien-Nr. {serial}", '"serial": {serial}, "model": "a2A"',
    ],
    "address": ["MAC {mac}", "camera at {mac} answers", "mac: {bare_mac}", "interface eth0 {dashed_mac} up"],
    "token": [
        "Authorization: Bearer {token}", "api_key={token}&n=3", "password: {token}", "Passwort: {token}",
        "密码\uff1a{token}",
        "GITHUB_TOKEN=ghp_{token}", "GET https://x.example/a?access_token={token}",
    ],
}  # fmt: skip
# Names met again, without a word that says what they are.
AGAIN = [
    "camera {serial} lost", "{person} stopped it", "{host} not reachable", "copied to D:\\{account}\\x",
    "device {bare_mac} gone", "cam_{serial}_1.png", "sent {token} again", "{chinese}停止了测量", "{upper} logged off",
]  # fmt: skip
KEPT = ["camera C01: rms 0.0523 px of 1544 dots", "2026-11-26 13:00:01 INFO 12.5 °C, 40.012 mm", "P12 was taken"]


def people(chance: random.Random) -> dict[str, str]:
    """Names of one person, computer and camera, in the forms in which they are met."""
    first, last = chance.choice(FIRST), chance.choice(LAST)
    account = chance.choice(
        [f"{first[0]}{last}".replace(" ", "").replace("'", "").lower(), f"{first}.{last}".replace(" ", "")]
    )
    folder = chance.choice([f"{first} {last}", account])
    mac = [f"{chance.randrange(256):02x}" for _ in range(6)]
    serial = chance.choice(
        [str(chance.randrange(10**7, 10**8)), f"50-{chance.randrange(10**9):010d}", f"FX{chance.randrange(10**6):06d}"]
    )
    words = {
        "person": f"{first} {last}", "upper": f"{first} {last}".upper(), "account": account,
        "windows": f"C:\\Users\\{folder}", "windows_escaped": f"C:\\\\Users\\\\{folder}",
        "linux": f"/home/{account}", "encoded": folder.replace(" ", "%20"), "chinese": chance.choice(CHINESE),
        "host": chance.choice(HOSTS), "serial": serial, "mac": ":".join(mac), "dashed_mac": "-".join(mac).upper(),
        "bare_mac": "".join(mac), "token": f"{chance.getrandbits(96):024x}", "number": str(chance.randrange(100)),
    }  # fmt: skip
    return words


def secrets_of(words: Mapping[str, str], text: str) -> list[str]:
    """What of these names a text still shows, in any case of letters."""
    parts = [part for part in re.split(r"\s", words["person"]) if len(part) > 2 and part != "von"]
    told = [*parts, *(words[key] for key in ("account", "chinese", "host", "serial", "mac", "bare_mac", "token"))]
    return [one for one in told if one.lower() in text.lower()]


@pytest.mark.parametrize("seed", range(200))
def test_no_name_is_left_of_random_logs(seed: int) -> None:
    chance = random.Random(seed)
    words = people(chance)
    met = [chance.choice(lines).format_map(words) for lines in LINES.values() for _ in range(2)]
    met += [
        f"operator: {words['person']}",
        f"S/N {words['serial']}",
        f"hostname={words['host']}",
        f"MAC: {words['mac']}",
    ]
    met += [f"user: {words['account']}", f"操作员\uff1a{words['chinese']}", f"token={words['token']}"]
    again = [one.format_map(words) for one in AGAIN] + KEPT
    chance.shuffle(met)
    document = {
        "format": "spherecal/x", "label": f"by {words['person']} on {words['host']}", "kind": "brown",
        "cameras": [{"id": words["serial"], "serial": words["serial"]}], "by": words["account"],
    }  # fmt: skip
    files = {
        "logs/1.log": "\r\n".join(again).encode(), "logs/2.log": "\n".join(met).encode(),
        "x.json": json.dumps(document).encode(),
        "x.csv": f"camera,u,v\n{words['serial']},1.5,2\nC02,{chance.randrange(9999)},3\n".encode(),
    }  # fmt: skip
    redactor = Redactor(files)
    done = {redactor.path(name): redactor.file(name, data).decode() for name, data in files.items()}
    for name, text in done.items():
        assert not secrets_of(words, text.replace('"brown"', "")), (name, text)  # the kind of lens stays
    for line in KEPT:
        assert line in done["logs/1.log"]
    changed = json.loads(done["x.json"])
    camera = changed["cameras"][0]
    assert changed["kind"] == "brown" and camera["id"] == camera["serial"] and changed["format"] == "spherecal/x"
    assert done["x.csv"].splitlines()[1] == f"{camera['id']},1.5,2"
    assert done["x.csv"].splitlines()[2] == files["x.csv"].decode().splitlines()[2]
    assert not secrets_of(words, " ".join(redactor.summary()))
    shown = " ".join(redactor.replaced())
    assert words["serial"] in shown and words["host"] in shown and words["token"] not in shown
    again_done = Redactor({name: text.encode() for name, text in done.items()})
    assert {name: again_done.file(name, text.encode()).decode() for name, text in done.items()} == done


def test_the_names_of_the_issue() -> None:
    log = (
        "C:\\Users\\FIRST LAST\\x operator: FIRST LAST\nS/N 40012345 lost, then 40012345 came back\n"
        "COMPUTERNAME=RECHNER7 smb://store9/a /data/users/someone/b 00:30:53:1a:2b:3c https://other:pass7word@x.org\n"
        "Authorization: Bearer abcdefgh12345678\nLAST has left RECHNER7 and store9"
    )
    text = Redactor({"a.log": log.encode()}).text(log)
    told = (
        "FIRST",
        "LAST",
        "40012345",
        "RECHNER7",
        "store9",
        "someone",
        "00:30:53",
        "other:",
        "pass7word",
        "abcdefgh1",
    )
    assert not [one for one in told if one in text], text


def test_words_of_our_files_stay() -> None:
    """Every value that a schema allows, where somebody is called so: documents stay readable."""
    values: set[str] = set()

    def walk(node: object) -> None:
        if isinstance(node, dict):
            values.update(one for one in (*node.get("enum", ()), node.get("const")) if isinstance(one, str))
        for one in node.values() if isinstance(node, dict) else node if isinstance(node, list) else ():
            walk(one)

    for path in (ROOT / "docs" / "schemas").glob("*.json"):
        walk(json.loads(path.read_text()))
    redactor = Redactor({"a.log": "\n".join(f"operator: {one}" for one in sorted(values | WORDS)).encode()})
    data = json.dumps({"values": sorted(values)}).encode()
    assert json.loads(redactor.file("x.json", data))["values"] == sorted(values)
    assert set(KINDS) >= {"person", "host", "serial", "address", "token"}


def test_dates_and_numbers_are_no_serial_numbers() -> None:
    redactor = Redactor({"a.json": b'{"serial": 2026}'})
    assert (
        redactor.text("2026-05-04T03:02:01 2026.5 mm of camera 2026")
        == "2026-05-04T03:02:01 2026.5 mm of camera serial-1"
    )


def test_the_list_of_names_is_shown_and_not_sent(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "s").mkdir()
    make_session(tmp_path / "s")
    (tmp_path / "a.log").write_text("operator: FIRST LAST\n")
    out = tmp_path / "b.zip"
    assert main(["support-bundle", str(tmp_path / "s"), "-o", str(out), "--log-file", str(tmp_path / "a.log")]) == 0
    printed = capsys.readouterr()
    assert re.search(r"person-\d: FIRST LAST", printed.out + printed.err)
    with zipfile.ZipFile(out) as bundle:
        for name in bundle.namelist():
            assert b"FIRST" not in bundle.read(name)

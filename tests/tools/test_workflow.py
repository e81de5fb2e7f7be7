"""The workflow runs on all systems, and what it runs is there."""

import re
import shlex
import tomllib
from pathlib import Path

import perfanim
import pytest
import yaml
from document_commands import make_targets

ROOT = Path(perfanim.__file__).parent
SYSTEMS = {"ubuntu-latest", "windows-latest", "macos-latest"}
WORKFLOWS = sorted((ROOT / ".github" / "workflows").glob("*.yml"))
JOBS = {
    (path.name, name): job
    for path in WORKFLOWS
    for name, job in yaml.safe_load(path.read_text(encoding="utf-8"))["jobs"].items()
}


def commands(job: dict) -> list[list[str]]:
    """Return the words of each command of a job."""
    lines = [step["run"] for step in job["steps"] if "run" in step]
    return [shlex.split(line) for text in lines for line in re.split(r"\n|&&", text) if line.strip()]


def test_core_and_add_on_are_tested_on_all_systems():
    tested: dict[str, set[str]] = {}
    for job in JOBS.values():
        for words in commands(job):
            if "pytest" in words:
                for folder in [word for word in words if word.startswith("tests/")]:
                    tested.setdefault(folder, set()).update(job["strategy"]["matrix"]["os"])
    assert {"tests/core", "tests/addon"} <= set(tested)
    assert all(systems == SYSTEMS for systems in tested.values())


@pytest.mark.parametrize("name", JOBS, ids=lambda name: name[1])
def test_what_a_job_runs_is_there(name):
    job = JOBS[name]
    assert job["timeout-minutes"] <= 120
    systems = job.get("strategy", {}).get("matrix", {}).get("os") or [job["runs-on"]]
    assert set(systems) <= SYSTEMS
    assert commands(job)
    for words in commands(job):
        assert words[0] in ("make", "python", "sudo"), words
        if words[0] == "make":
            assert systems == ["ubuntu-latest"], "the Makefile has the paths of Linux and macOS"
            assert {word for word in words[1:] if "=" not in word} <= make_targets(), words
        for word in words:
            if re.match(r"(tests|tools)/", word):
                assert (ROOT / word).exists(), word
    for step in job["steps"]:
        assert "run" in step or re.fullmatch(r"actions/[\w-]+@v\d+", step["uses"]), step
        if cached := step.get("with", {}).get("cache-dependency-path"):
            assert (ROOT / cached).is_file()


def test_the_add_on_is_tested_on_each_blender_of_the_makefile():
    text = (ROOT / "Makefile").read_text(encoding="utf-8")
    wanted = set(re.search(r"^BPY \?= (.+)$", text, re.MULTILINE)[1].split())
    blenders = JOBS["tests.yml", "addon"]["strategy"]["matrix"]["blender"]
    assert {blender["bpy"] for blender in blenders} == wanted
    for blender in blenders:
        assert f"NUMPY_OF_{blender['bpy']} := {blender['numpy']}\n" in text
        assert f"PYTHON_OF_{blender['bpy']} := $(PYTHON{blender['python'].replace('.', '')})\n" in text
    manifest = tomllib.loads((ROOT / "blender_manifest.toml").read_text(encoding="utf-8"))
    oldest = min(wanted, key=lambda version: [int(part) for part in version.split(".")])
    assert manifest["blender_version_min"] == f"{oldest}.0"


def test_the_add_on_is_tested_on_the_next_blenders():
    job = JOBS["blender-next.yml", "addon"]
    assert set(job["strategy"]["matrix"]["blender"]) == {"release", "daily"}
    assert ["python", "tools/newest_blender.py", "${{", "matrix.blender", "}}", "--to", "newest"] in commands(job)
    text = (ROOT / ".github" / "workflows" / "blender-next.yml").read_text(encoding="utf-8")
    assert yaml.safe_load(text)[True]["schedule"], "it runs without a push"  # YAML reads `on` as true


def test_each_target_is_phony_and_has_a_line_of_help():
    text = (ROOT / "Makefile").read_text(encoding="utf-8")
    phony = set(re.search(r"^\.PHONY: (.+)$", text.replace("\\\n", " "), re.MULTILINE)[1].split())
    helped = set(re.findall(r"^([a-z-]+):.* ## \w", text, re.MULTILINE))
    assert phony == helped and len(phony) <= 20


def test_each_check_before_a_commit_is_one_of_make_check():
    hooks = yaml.safe_load((ROOT / ".pre-commit-config.yaml").read_text(encoding="utf-8"))["repos"][0]["hooks"]
    recipe = (ROOT / "Makefile").read_text(encoding="utf-8").partition("\ncheck:")[2].partition("\n\n")[0]
    assert len(hooks) >= 4
    for hook in hooks:
        program = hook["entry"].split()[-1] if "python" in hook["entry"] else Path(hook["entry"].split()[0]).name
        assert program in recipe or hook["entry"].removeprefix(".venv/bin/python ") in recipe, hook["entry"]

"""What is installed: the wheel, its console script, its version, and how little importing costs."""

import ast
import re
import shlex
import subprocess
import sys
import tomllib
import venv
import zipfile
from dataclasses import fields
from pathlib import Path

import pytest

import pbrdf_bayes as pb
from pbrdf_bayes.cli import build_parser
from pbrdf_bayes.inference.parameters.priors import PRESETS
from pbrdf_bayes.io.scene_toml import scene_from_table

ROOT = Path(__file__).parents[2]


def run(*command, **options):
    return subprocess.run(
        list(map(str, command)), capture_output=True, text=True, timeout=300, check=False, **options
    )


@pytest.fixture(scope="module")
def project():
    return tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    folder = tmp_path_factory.mktemp("wheel")
    pip = (sys.executable, "-m", "pip", "wheel", "--no-deps", "--quiet", "--wheel-dir", folder)
    made = run(*pip, ROOT)
    if made.returncode and run(sys.executable, "-c", "import hatchling").returncode == 0:
        made = run(*pip, "--no-build-isolation", ROOT)
    if made.returncode and re.search(r"No matching distribution|Connection|Temporary", made.stderr):
        pytest.skip(f"no package index and no hatchling here: {made.stderr.strip()[-200:]}")
    assert made.returncode == 0, made.stderr
    return next(folder.glob("*.whl"))


@pytest.fixture(scope="module")
def installed(wheel, tmp_path_factory):
    """Environment with the wheel alone, no dependency of it; its folder of programs."""
    folder = tmp_path_factory.mktemp("installed")
    venv.create(folder, with_pip=False)
    programs = folder / ("Scripts" if sys.platform == "win32" else "bin")
    made = run(
        sys.executable, "-m", "pip", "--python", programs / "python", "install", "--quiet",
        "--no-deps", "--no-index", wheel,
    )  # fmt: skip
    assert made.returncode == 0, made.stderr
    return programs


def test_the_wheel_holds_every_module_and_every_resource(wheel):
    packed = {name for name in zipfile.ZipFile(wheel).namelist() if name.startswith("pbrdf_bayes/")}
    kinds = ("*.py", "*.json", "*.j2", "*.css")
    here = {
        path.relative_to(ROOT).as_posix()
        for kind in kinds
        for path in (ROOT / "pbrdf_bayes").rglob(kind)
        if "__pycache__" not in path.parts
    }
    assert here <= packed
    for name in (
        "report/design.html.j2",
        "report/template.html.j2",
        "report/report.css",
    ):
        assert f"pbrdf_bayes/{name}" in packed


def test_the_wheel_holds_nothing_else(wheel):
    names = zipfile.ZipFile(wheel).namelist()
    foreign = [n for n in names if not re.match(r"pbrdf_bayes/|pbrdf_bayes-[\d.]+\.dist-info/", n)]
    assert foreign == []
    assert [n for n in names if n.endswith((".nbi", ".nbc", ".pyc", ".csv"))] == []


def test_the_wheel_says_what_it_is(wheel, project):
    archive = zipfile.ZipFile(wheel)
    info = next(name for name in archive.namelist() if name.endswith("METADATA"))
    metadata = archive.read(info).decode("utf-8")
    assert f"\nVersion: {pb.__version__}\n" in metadata
    assert "\nLicense-Expression: MIT\n" in metadata
    assert "\nRequires-Python: <3.15,>=3.11\n" in metadata
    for extra in project["project"]["optional-dependencies"]:
        assert f"\nProvides-Extra: {extra}\n" in metadata


def test_the_console_script_answers_without_any_dependency(installed):
    """--help and --version of an installed script need nothing but the standard library."""
    helped = run(installed / "pbrdf-bayes", "--help")
    assert helped.returncode == 0, helped.stderr
    for verb in ("check", "fit", "report", "predict", "simulate"):
        assert re.search(rf"^ +{verb} ", helped.stdout, re.MULTILINE), verb
        answer = run(installed / "pbrdf-bayes", verb, "--help")
        assert answer.returncode == 0, answer.stderr
    assert run(installed / "pbrdf-bayes", "--version").stdout.split()[-1] == pb.__version__
    as_module = run(installed / "python", "-m", "pbrdf_bayes", "--help")
    assert as_module.stdout.splitlines()[-1] == helped.stdout.splitlines()[-1]


def test_a_verb_that_is_not_there_is_a_usage_error(installed):
    answer = run(installed / "pbrdf-bayes", "fitt")
    assert answer.returncode == 2
    assert "Traceback" not in answer.stderr


def test_importing_the_package_loads_nothing_heavy():
    heavy = ("numpy", "scipy", "numba", "matplotlib", "pandas", "xarray", "emcee", "jinja2")
    code = f"import sys, pbrdf_bayes; print([m for m in {heavy} if m in sys.modules])"
    answer = run(sys.executable, "-c", code, cwd=ROOT)
    assert answer.stdout.strip() == "[]", answer.stderr


def test_help_loads_nothing_heavy():
    code = (
        "import sys, contextlib, io\n"
        "from pbrdf_bayes.cli import main\n"
        "with contextlib.redirect_stdout(io.StringIO()), contextlib.suppress(SystemExit):\n"
        "    main(['--help'])\n"
        "print([m for m in ('numpy', 'numba', 'matplotlib', 'pandas') if m in sys.modules])\n"
    )
    answer = run(sys.executable, "-c", code, cwd=ROOT)
    assert answer.stdout.strip() == "[]", answer.stderr


def test_the_version_is_the_same_everywhere():
    changelog = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    citation = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    assert re.search(r"^## \[(\d+\.\d+\.\d+)\]", changelog, re.MULTILINE)[1] == pb.__version__
    assert re.search(r"^version: (\S+)$", citation, re.MULTILINE)[1] == pb.__version__


def test_every_python_that_is_promised_is_classified(project):
    low, high = re.fullmatch(
        r">=3\.(\d+),<3\.(\d+)", project["project"]["requires-python"]
    ).groups()
    prefix = "Programming Language :: Python :: 3."
    listed = [c.removeprefix(prefix) for c in project["project"]["classifiers"] if prefix in c]
    assert listed == [str(minor) for minor in range(int(low), int(high))]


def test_every_dependency_has_a_lower_and_an_upper_bound(project):
    for requirement in project["project"]["dependencies"]:
        name, _, bounds = re.match(r"([\w-]+)(\[\w+\])?([^;]*)", requirement).groups()
        assert ">=" in bounds, name
        assert "<" in bounds or name == "xarray", name  # xarray's versions are dates


def test_the_files_that_the_project_promises_are_there(project):
    for name in ("README.md", "LICENSE", "CHANGELOG.md", "CITATION.cff", "CONTRIBUTING.md"):
        assert (ROOT / name).stat().st_size > 300, name
    for name in project["tool"]["hatch"]["build"]["targets"]["sdist"]["include"]:
        assert (ROOT / name).exists(), name


def blocks(language):
    """Code blocks of README in a language; '' for those without one."""
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    return [
        code
        for name, code in re.findall(r"```(\w*)\n(.*?)```", text, re.DOTALL)
        if name == language
    ]


def block_with(language: str, words: str) -> str:
    """The one block of the README in this language that holds these words."""
    (found,) = [text for text in blocks(language) if words in text]
    return found


def test_readme_lists_every_key_of_the_configuration_with_its_default():
    table = tomllib.loads(block_with("toml", "noise = "))
    defaults = {field.name: getattr(pb.RunConfig(), field.name) for field in fields(pb.RunConfig)}
    shown = {
        key: tuple(value) if isinstance(value, list) else value for key, value in table.items()
    }
    assert shown == defaults


def test_readmes_examples_of_priors_are_accepted():
    text = block_with("toml", "noise = ")
    table = tomllib.loads(text.replace("# n = {", "n = {").replace("# rho0 = {", "rho0 = {"))
    measurement = pb.simulate_measurement(pb.GREEN_PAINT, seed=1, theta_i_deg=[20.0])
    posterior = pb.build_posterior(measurement, pb.RunConfig(priors=table["priors"]))
    described = {spec.name: spec.prior.describe() for spec in posterior.specs}
    assert described["n"] == "Normal(1.5, 0.05) on [1.3, 1.7]"
    assert described["rho0"].startswith("LogNormal(median 0.3, factor 2")


def test_readmes_limits_and_items_are_accepted() -> None:
    from dataclasses import fields

    from pbrdf_bayes.document import Document
    from pbrdf_bayes.io.limits_toml import specification_from_table

    found = specification_from_table(tomllib.loads(block_with("toml", "[[limit]]")))
    assert [limit.name for limit in found.limits] == ["glare", "shade"]
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    listed = re.search(r"only the laboratory knows: `([^`]*)`", text)
    assert listed is not None
    assert re.split(r",\s+", listed[1]) == [f.name for f in fields(Document)]


def test_readmes_scene_is_accepted():
    scene = scene_from_table(tomllib.loads(block_with("toml", "stokes_incident = ")))
    assert scene.n_directions == 2 * 35 * 37
    assert scene.stokes_incident == "u"


def test_readmes_csv_is_read_without_a_warning(tmp_path):
    path = tmp_path / "example.csv"
    path.write_text(blocks("csv")[0], encoding="utf-8")
    measurement = pb.read_measurement(path)
    assert (len(measurement.brdf), len(measurement.dhr), measurement.warnings) == (4, 2, ())


def test_readmes_commands_are_understood():
    commands = [line for line in "".join(blocks("")).splitlines() if line.startswith("pbrdf-bayes")]
    assert {shlex.split(line)[1] for line in commands} >= {
        "check", "fit", "report", "predict", "simulate",
    }  # fmt: skip
    for line in commands:
        build_parser().parse_args(shlex.split(line)[1:])


def test_readmes_python_uses_the_public_interface():
    tree = ast.parse(blocks("python")[0])
    used = {
        node.attr
        for node in ast.walk(tree)
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name)
        if node.value.id == "pb"
    }
    assert used
    assert used <= set(pb.__all__)


def test_readmes_links_lead_somewhere():
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    targets = [target for target in re.findall(r"\]\(([^)#]+)", text) if "://" not in target]
    assert targets
    assert [target for target in targets if not (ROOT / target).exists()] == []


def test_readmes_priors_are_the_presets():
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    for preset, priors in PRESETS.items():
        row = next(line for line in text.splitlines() if line.startswith(f"| `{preset}` |"))
        cells = [cell.strip() for cell in row.strip("|").split("|")][1:]
        assert cells == [priors[name].describe() for name in ("n", "k", "sigma_n0", "rho0")]


@pytest.mark.skipif(sys.platform == "win32", reason="make and bash")
def test_the_makefile_lists_its_targets():
    answer = run("make", "--no-print-directory", cwd=ROOT)
    listed = [line.split()[1] for line in answer.stdout.splitlines()]
    assert listed == ["help", "demo", "test", "test-slow", "validate", "lint", "format", "clean"]
    assert run("bash", "-n", ROOT / ".ci" / "run").returncode == 0


@pytest.mark.skipif(sys.platform == "win32", reason="make and bash")
def test_a_python_that_is_too_old_is_refused_with_a_remedy(tmp_path):
    old = tmp_path / "python3"
    old.write_text('#!/bin/sh\necho "Python 3.9 at here: needs 3.11 to 3.14" >&2\nexit 1\n')
    old.chmod(0o755)
    answer = run("make", "demo", f"PYTHON={old}", f"VENV={tmp_path / 'venv'}", cwd=ROOT)
    assert answer.returncode != 0
    assert "Install Python 3.11 or newer, or name one: make demo PYTHON=" in answer.stderr
    assert not (tmp_path / "venv").exists()

"""The public names: there, lazy, documented, and errors that can be read."""

from __future__ import annotations

import ast
import dataclasses
import inspect
import re
import subprocess
import sys
from importlib import metadata
from pathlib import Path
from typing import Any

import pytest

import pbrdf_bayes as pb

NAMES = sorted(set(pb.__all__) - {"__version__"})
FUNCTIONS = [n for n in NAMES if inspect.isfunction(getattr(pb, n))]
CLASSES = [n for n in NAMES if inspect.isclass(getattr(pb, n))]
ERRORS = [n for n in CLASSES if issubclass(getattr(pb, n), Exception)]
RECORDS = [n for n in CLASSES if dataclasses.is_dataclass(getattr(pb, n))]
CONTRACT = {"Parameters", "brdf", "dhr", "read_measurement", "build_posterior", "fit", "RunConfig"}


def sections(doc: str) -> dict[str, str]:
    """Sections of a numpydoc docstring."""
    parts = re.split(r"^(\w[\w ]*)\n-{3,}$", inspect.cleandoc(doc), flags=re.MULTILINE)
    return {"Summary": parts[0]} | dict(zip(parts[1::2], parts[2::2], strict=True))


def described(text: str) -> set[str]:
    """Names that a section of parameters or attributes describes: unindented ``a, b : type``."""
    lines = [line.split(" : ")[0] for line in text.splitlines() if re.match(r"[\w*]", line)]
    return {name.strip(" *`") for line in lines for name in line.split(",")}


def test_every_name_resolves_and_is_listed() -> None:
    assert sorted(set(pb.__all__)) == sorted(pb.__all__)
    for name in pb.__all__:
        assert getattr(pb, name) is not None, name
    assert set(dir(pb)) == set(pb.__all__)
    assert set(NAMES) >= CONTRACT


def test_an_unknown_name_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match=r"module 'pbrdf_bayes' has no attribute 'no_such'"):
        _ = pb.no_such  # type: ignore[attr-defined]
    with pytest.raises(ImportError, match="no_such"):
        exec("from pbrdf_bayes import no_such", {})


def test_type_checkers_see_what_is_loaded_lazily() -> None:
    """Names under TYPE_CHECKING, the table of homes and __all__ are the same."""
    tree = ast.parse(Path(pb.__file__).read_text(encoding="utf-8"))
    block = next(n for n in tree.body if isinstance(n, ast.If))
    homes = {
        alias.name: str(node.module).removeprefix("pbrdf_bayes.")
        for node in block.body
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }
    assert homes == pb._HOME
    assert set(homes) == set(NAMES)


def test_importing_the_package_loads_nothing_heavy() -> None:
    heavy = ("numpy", "numba", "scipy", "pandas", "xarray", "matplotlib", "emcee", "jinja2")
    code = (
        "import sys, pbrdf_bayes\n"
        f"print([m for m in {heavy!r} if m in sys.modules])\n"
        "pbrdf_bayes.DomainError\n"
        f"print([m for m in {heavy!r} if m in sys.modules])\n"
        "pbrdf_bayes.brdf\n"
        "print('numpy' in sys.modules, [m for m in ('pandas','xarray','matplotlib') if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines() == ["[]", "[]", "True []"]


def test_the_version_is_that_of_the_installed_package() -> None:
    assert re.fullmatch(r"\d+\.\d+\.\d+([a-z]+\d+)?", pb.__version__)
    assert metadata.version("pbrdf-bayes") == pb.__version__


@pytest.mark.parametrize("name", FUNCTIONS)
def test_functions_document_every_argument(name: str) -> None:
    function = getattr(pb, name)
    doc = sections(function.__doc__)
    arguments = set(inspect.signature(function).parameters)
    assert described(doc["Parameters"]) == arguments
    if inspect.signature(function).return_annotation not in ("None", None):
        assert doc["Returns"].strip()
    assert doc["Summary"].strip()


@pytest.mark.parametrize("name", FUNCTIONS)
def test_functions_document_the_errors_they_raise(name: str) -> None:
    """What the body raises itself is named under Raises."""
    function = getattr(pb, name)
    tree = ast.parse(inspect.getsource(function))
    raised = {
        ast.unparse(node.exc.func)
        for node in ast.walk(tree)
        if isinstance(node, ast.Raise) and isinstance(node.exc, ast.Call)
    }
    documented = sections(function.__doc__).get("Raises", "")
    assert {error for error in raised if error not in documented} == set()


@pytest.mark.parametrize("name", RECORDS)
def test_records_document_every_field(name: str) -> None:
    record = getattr(pb, name)
    doc = sections(record.__doc__)
    fields = {f.name for f in dataclasses.fields(record)}
    assert described(doc["Attributes"]) == fields


@pytest.mark.parametrize("name", RECORDS)
def test_records_are_frozen(name: str) -> None:
    params: Any = getattr(pb, name).__dataclass_params__
    assert params.frozen


@pytest.mark.parametrize("name", CLASSES)
def test_public_methods_are_documented(name: str) -> None:
    for attribute, value in vars(getattr(pb, name)).items():
        callable_ = getattr(value, "fget", None) or getattr(value, "func", None) or value
        if not attribute.startswith("_") and inspect.isfunction(callable_):
            assert callable_.__doc__, f"{name}.{attribute}"


@pytest.mark.parametrize("name", ["brdf", "dhr", "mueller", "reciprocal_brdf", "stokes"])
def test_units_are_stated(name: str) -> None:
    doc = getattr(pb, name).__doc__
    assert "[deg]" in doc
    assert "[sr^-1]" in doc or "[1]" in doc
    assert "Eq." in doc
    assert ">>>" in doc


@pytest.mark.parametrize("name", ERRORS)
def test_errors_can_be_read_caught_and_shown(name: str) -> None:
    error = getattr(pb, name)
    assert issubclass(error, pb.PbrdfError)
    caught = error("rho0 = 9 is outside [0.001, 4]")
    assert str(caught) == "rho0 = 9 is outside [0.001, 4]"
    assert repr(caught) == f"{name}('rho0 = 9 is outside [0.001, 4]')"
    assert caught.exit_code in (2, 3)
    assert error.__doc__
    assert error.__module__ == "pbrdf_bayes.errors"


def test_the_errors_are_a_closed_list() -> None:
    """Every error class of the package derives from one base and is public."""
    from pbrdf_bayes import errors

    found = {
        n for n, v in vars(errors).items() if inspect.isclass(v) and v.__module__ == errors.__name__
    }
    assert found == set(ERRORS)
    assert {pb.DataError, pb.ConfigError, pb.DomainError} <= set(ValueError.__subclasses__())
    assert issubclass(pb.ConvergenceError, pb.FitError)
    assert (pb.DataError.exit_code, pb.FitError.exit_code) == (2, 3)


def test_records_print_their_content() -> None:
    assert repr(pb.GREEN_PAINT) == "Parameters(n=1.526, k=0.193, sigma_n0=0.4528, rho0=0.47)"
    assert "accuracy='draft'" in repr(pb.RunConfig(accuracy="draft"))


def test_arguments_after_the_data_are_keywords() -> None:
    """Arrays are positional, choices are not."""
    for name in ("fit", "read_measurement", "simulate_measurement"):
        kinds = [p.kind for p in inspect.signature(getattr(pb, name)).parameters.values()]
        assert inspect.Parameter.KEYWORD_ONLY in kinds, name
    with pytest.raises(TypeError):
        pb.Parameters(1.5, 0.1, 0.5, 0.4)  # type: ignore[misc]
    with pytest.raises(TypeError):
        pb.RunConfig("iid")  # type: ignore[misc]

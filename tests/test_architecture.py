"""Imports point one way: read from the source, so that a lazy import counts as well."""

from __future__ import annotations

import ast
import sys
from collections.abc import Iterator
from functools import cache
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

import pbrdf_bayes

ROOT = Path(pbrdf_bayes.__file__).parent
PACKAGE = ROOT.name

LAYERS: tuple[tuple[str, ...], ...] = (
    ("errors", "effects_table", "quantities"),
    ("physics",),
    ("config", "measurement", "records", "results", "verdict"),
    ("scenes", "specification", "document", "words"),
    ("readings",),
    ("model",),
    ("scene", "inference", "io", "report"),
    ("verdicts", "analysis"),
    ("conform", "design"),
    ("workflow",),
    ("bench", "batch", "mitsuba"),
    ("verbs",),
    ("cli",),
    ("__main__",),
)
"""Lowest first. A part imports from parts below it only; parts of one layer are independent."""
BELOW_MODEL = {"model": {"physics", "errors"}, "config": {"errors"}, "measurement": {"errors"}}

HOMES = {
    "matplotlib": {"report", "bench"}, "jinja2": {"report", "bench"}, "nlopt": {"inference.optimum.map_fit"},
    "emcee": {"inference.sampling.moves", "inference.sampling.ensembles", "inference.sampling.sampling"}, "arviz_stats": {"inference.arviz_adapter"},
    "jsonschema": set(), "msgspec": {"records", "io.schemas", "workflow.summary"}, "tomllib": {"io"}, "csv": {"io", "batch.index"}, "argparse": {"verbs", "cli"}, "pandas": {"io"},
    "h5py": set(), "xarray": {"io", "workflow.tree", "results"}, "numba": {"physics", "inference", "bench", "workflow.compile_ahead"},
    "llvmlite": {"physics.elementary"}, "fcntl": {"io.locks"}, "signal": {"cli", "batch.work"}, "distributed": {"batch.executors"},
    "threadpoolctl": {"inference", "bench", "design"}, "subprocess": {"workflow.compile_ahead", "io.print_pdf"}, "pickle": set(), "arviz": set(),
    "random": set(), "pathlib": {"io", "analysis", "workflow.compile_ahead", "workflow", "verbs", "cli", "bench", "batch", "physics.compiled"},
    "os": {"io", "cli", "bench", "batch", "verbs.terminal"}, "tempfile": {"io"}, "time": {"inference.effects_choice.choose", "inference.sampling.ensembles", "io.checkpoint", "workflow.fitting", "verbs.terminal", "bench", "batch"},
}  # fmt: skip
"""What only these parts import, wherever it is imported at all."""


LIGHT = {
    "errors", "cli", "verbs", "verbs.arguments", "verbs.batch", "verbs.conform", "verbs.design",
    "verbs.export", "verbs.one_sample",
}  # fmt: skip
"""What loads with the command line."""


@cache
def modules() -> dict[str, ast.Module]:
    """Syntax tree of every module by its dotted name inside the package."""
    found = {}
    for path in sorted(ROOT.rglob("*.py")):
        parts = path.relative_to(ROOT).with_suffix("").parts
        name = ".".join(parts[:-1] if parts[-1] == "__init__" and len(parts) > 1 else parts)
        found[name] = ast.parse(path.read_text(encoding="utf-8"))
    return found


def imported(tree: ast.Module) -> Iterator[str]:
    """Full dotted names of everything imported, inside functions too."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, "relative import"
            for alias in node.names:
                yield f"{node.module}.{alias.name}"


def resolve(name: str) -> str | None:
    """Module of this package that an imported name means; None for others and for the root."""
    if not name.startswith(f"{PACKAGE}."):
        return None
    parts = name.split(".")[1:]
    for n in (len(parts), len(parts) - 1):
        if n and ".".join(parts[:n]) in modules():
            return ".".join(parts[:n])
    assert len(parts) == 1, f"{name} is no module of the package"
    return None  # a name of the package itself, such as __version__


@cache
def edges() -> dict[str, set[str]]:
    """Modules that each module imports, the package's own __init__ left out."""
    return {
        name: {found for x in imported(tree) if (found := resolve(x)) is not None and found != name}
        for name, tree in modules().items()
        if name != "__init__"
    }


def part(module: str) -> str:
    return module.split(".")[0]


def rank(module: str) -> int:
    return next(i for i, names in enumerate(LAYERS) if part(module) in names)


def test_every_module_has_its_layer() -> None:
    listed = [name for layer in LAYERS for name in layer]
    assert len(listed) == len(set(listed))
    assert {part(m) for m in modules()} - {"__init__"} == set(listed)


def test_imports_point_down() -> None:
    wrong = [
        f"{importer} -> {target}"
        for importer, targets in edges().items()
        for target in sorted(targets)
        if part(importer) != part(target) and rank(importer) <= rank(target)
    ]
    assert wrong == []


def test_there_are_no_cycles() -> None:
    try:
        tuple(TopologicalSorter(edges()).static_order())
    except CycleError as error:
        pytest.fail(f"cycle: {' -> '.join(error.args[1])}")


def reachable(start: str) -> set[str]:
    """Everything a module pulls in, directly or not."""
    found: set[str] = set()
    waiting = {m for m in edges() if part(m) == start}
    while waiting:
        module = waiting.pop()
        found.add(module)
        waiting |= edges()[module] - found
    return found


@pytest.mark.parametrize(
    ("start", "never"),
    [
        ("physics", {"errors", "config", "model", "measurement", "io", "inference", "report"}),
        ("report", {"physics", "model", "inference", "io", "workflow", "verdicts"}),
        (
            "inference",
            {"io", "report", "workflow", "verdicts"},
        ),
        ("io", {"inference", "report", "workflow", "physics", "model"}),
        ("results", {"physics", "model", "io", "inference", "report"}),
        ("readings", {"model", "inference", "io", "report"}),
    ],
)
def test_what_a_part_never_reaches(start: str, never: set[str]) -> None:
    """Not even through another module: reports do not evaluate the model, physics knows no data."""
    assert {m for m in reachable(start) if part(m) in never} == set()


@pytest.mark.parametrize("name", sorted(HOMES))
def test_a_library_is_imported_at_home_only(name: str) -> None:
    users = {
        module
        for module, tree in modules().items()
        if any(x.split(".")[0] == name for x in imported(tree))
    }
    strangers = {u for u in users if not any(u == h or u.startswith(f"{h}.") for h in HOMES[name])}
    assert strangers == set()


def test_physics_imports_numpy_and_numba_only() -> None:
    allowed = {PACKAGE, "numpy", "numba", "llvmlite"} | set(sys.stdlib_module_names)
    for name, tree in modules().items():
        if part(name) == "physics" and name != "physics.compiled":  # looks at its own sources
            outside = {x.split(".")[0] for x in imported(tree)} - allowed
            assert outside == set(), name
            standard = {x.split(".")[0] for x in imported(tree)} & set(sys.stdlib_module_names)
            world = {
                "os",
                "sys",
                "io",
                "pathlib",
                "time",
                "random",
                "threading",
                "json",
                "subprocess",
            }
            assert standard & world == set(), name


def test_only_light_modules_load_with_the_command_line() -> None:
    """At module level the command line and the package import the standard library and errors."""
    for name in ("__init__", *sorted(LIGHT - {"errors"}), "__main__"):
        tree = modules()[name]
        top = ast.Module(
            [n for n in tree.body if isinstance(n, ast.Import | ast.ImportFrom)], type_ignores=[]
        )
        found = set(imported(top))
        own = {resolve(x) for x in found if x.split(".")[0] == PACKAGE} - {None}
        assert own <= LIGHT, name
        others = {x.split(".")[0] for x in found} - {PACKAGE}
        assert others <= set(sys.stdlib_module_names), name


def test_randomness_is_an_argument() -> None:
    """No generator at module level, no legacy state but the one emcee asks for."""
    for name, tree in modules().items():
        for node in tree.body:
            for call in ast.walk(node):
                if isinstance(call, ast.Call) and not isinstance(
                    node, ast.FunctionDef | ast.ClassDef
                ):
                    assert "default_rng" not in ast.unparse(call.func), name
        text = ast.unparse(tree)
        assert "np.random.seed" not in text, name
        assert ("RandomState(" in text) <= (name == "inference.sampling.ensembles"), name


def test_nothing_is_swallowed() -> None:
    """No bare except, and no handler that does nothing at all."""
    for name, tree in modules().items():
        for node in ast.walk(tree):
            if isinstance(node, ast.ExceptHandler):
                assert node.type is not None, f"{name}:{node.lineno}"
                assert not all(isinstance(x, ast.Pass) for x in node.body), f"{name}:{node.lineno}"

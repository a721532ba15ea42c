"""The run folder: whole or not at all, one process at a time, read back as it was written."""

from __future__ import annotations

import errno
import hashlib
import json
import os
import re
import shutil
import stat
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr
from hypothesis import example, given, settings
from hypothesis import strategies as st

import pbrdf_bayes as pb
from pbrdf_bayes.analysis import load_analysis
from pbrdf_bayes.cli import main
from pbrdf_bayes.errors import RunFolderError
from pbrdf_bayes.io import run_folder
from pbrdf_bayes.io.locks import GO_ON, only_one_at_a_time
from pbrdf_bayes.io.run_folder import (
    is_finished,
    load_summary,
    locked,
    new_run_folder,
    save_analysis,
    validate_summary,
    write_text,
)
from pbrdf_bayes.io.safe_names import safe_name
from pbrdf_bayes.records.values import plain
from pbrdf_bayes.results import Analysis

FILES = {"summary.json", "posterior.nc", "config.toml", "report.html", "log.txt"}


@pytest.fixture
def run(finished_run: Path, tmp_path: Path) -> Path:
    """A copy of the finished run that may be damaged."""
    return Path(shutil.copytree(finished_run, tmp_path / "run"))


@pytest.fixture(scope="module")
def loaded(finished_run: Path) -> Analysis:
    return load_analysis(finished_run)


def damage(path: Path, how: str) -> None:
    """Take a file away, cut or empty it, or flip one bit in its middle."""
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 1
    kept = {"cut": len(content) // 3, "empty": 0}.get(how, len(content))
    path.unlink() if how == "missing" else path.write_bytes(content[:kept])


def visible(folder: Path) -> set[str]:
    return {p.name for p in folder.iterdir() if not p.name.startswith(".")}


# ------------------------------------------------------------------------------------ the content


def test_the_folder_holds_the_documented_files(finished_run: Path) -> None:
    assert visible(finished_run) == FILES
    leftovers = {p.name for p in finished_run.iterdir()} - FILES
    assert leftovers <= {".lock"}


def test_files_are_plain_text_or_netcdf_and_never_pickles(finished_run: Path) -> None:
    with (finished_run / "posterior.nc").open("rb") as file:
        assert file.read(8) == b"\x89HDF\r\n\x1a\n"
    for path in finished_run.iterdir():
        assert not path.read_bytes().startswith(b"\x80\x04"), path
    text = (finished_run / "config.toml").read_text(encoding="utf-8")
    assert tomllib.loads(text)["accuracy"] == "draft"
    log = (finished_run / "log.txt").read_text(encoding="utf-8")
    assert "seed 1" in log
    assert "optimise" in log


@pytest.mark.skipif(os.name == "nt", reason="POSIX permissions")
def test_files_can_be_read_by_others(finished_run: Path) -> None:
    """Temporary files are private; what is moved into place follows the umask or is 0644."""
    modes = {p.name: stat.S_IMODE(p.stat().st_mode) for p in finished_run.iterdir()}
    assert all(mode & stat.S_IRUSR and mode & stat.S_IROTH for mode in modes.values()), modes


def test_summary_is_json_without_nan_and_fits_its_schema(finished_run: Path) -> None:
    text = (finished_run / "summary.json").read_text(encoding="utf-8")

    def refuse(word: str) -> float:
        raise AssertionError(word)

    summary = json.loads(text, parse_constant=refuse)
    validate_summary(summary, where="here")
    assert summary["schema_version"] == 1


def test_a_run_reads_back_as_it_was_saved(loaded: Analysis, tmp_path: Path) -> None:
    folder = tmp_path / "again"
    with locked(folder):
        save_analysis(loaded, folder, report="<html></html>", log="log\n")
    again = load_analysis(folder)
    assert again.summary == loaded.summary
    assert again.config_toml == loaded.config_toml
    assert list(again.draws.children) == list(loaded.draws.children)
    for name in loaded.draws.children:
        xr.testing.assert_identical(again.draws[name].to_dataset(), loaded.draws[name].to_dataset())
    assert (folder / "report.html").read_text(encoding="utf-8") == "<html></html>"


def test_a_loaded_run_does_not_hold_its_file_open(run: Path) -> None:
    loaded = load_analysis(run)
    shutil.rmtree(run)
    assert np.isfinite(loaded.draws["posterior"]["n"].values).all()


# ------------------------------------------------------------------------------------------ damage


def test_a_folder_without_summary_is_not_a_run(run: Path, tmp_path: Path) -> None:
    (run / "summary.json").unlink()
    assert not is_finished(run)
    with pytest.raises(RunFolderError, match=r"not a finished run \(no summary\.json\)"):
        load_analysis(run)
    with pytest.raises(RunFolderError, match="not a finished run"):
        load_summary(tmp_path / "nowhere")


@pytest.mark.parametrize("text", ["", "{", '{"a": 1', "\x00\x01", "[]", "null", "1"])
def test_a_damaged_summary_is_named(run: Path, text: str) -> None:
    (run / "summary.json").write_text(text, encoding="utf-8")
    with pytest.raises(RunFolderError, match=r"summary\.json"):
        load_summary(run)


def test_a_summary_that_is_not_utf8(run: Path) -> None:
    (run / "summary.json").write_bytes(b'{"sample": "\xff\xfe"}')
    with pytest.raises(RunFolderError, match=r"summary\.json: damaged"):
        load_summary(run)


@pytest.mark.parametrize("version", [0, 2, "1", None])
def test_another_schema_version_is_refused(run: Path, version: Any) -> None:
    path = run / "summary.json"
    summary = json.loads(path.read_text(encoding="utf-8")) | {"schema_version": version}
    path.write_text(json.dumps(summary), encoding="utf-8")
    with pytest.raises(RunFolderError, match=r"schema version .*this program reads 1"):
        load_summary(run)


def test_an_entry_that_does_not_fit_the_schema_is_named(run: Path) -> None:
    path = run / "summary.json"
    summary = json.loads(path.read_text(encoding="utf-8"))
    summary["parameters"]["n"]["mean"] = "one and a half"
    path.write_text(json.dumps(summary), encoding="utf-8")
    with pytest.raises(RunFolderError, match=r"parameters/n/mean"):
        load_summary(run)


def test_a_summary_that_does_not_fit_is_not_written(loaded: Analysis, tmp_path: Path) -> None:
    broken = Analysis({**loaded.summary, "verdict": "MAYBE"}, loaded.draws, loaded.config_toml)
    with pytest.raises(RunFolderError, match=r"verdict"):
        save_analysis(broken, tmp_path, report="", log="")
    assert list(tmp_path.iterdir()) == []


def test_one_bit_of_a_draw_is_noticed(run: Path) -> None:
    """HDF5 has no checksum of its own here: the number would only be another one."""
    content = bytearray((run / "posterior.nc").read_bytes())
    draws = load_analysis(run).draws["posterior"]["n"].values
    at = content.find(np.ascontiguousarray(draws.ravel()[:4]).tobytes())
    assert at > 0
    content[at] ^= 1
    (run / "posterior.nc").write_bytes(content)
    with pytest.raises(RunFolderError, match=r"posterior\.nc does not have the checksum"):
        load_analysis(run)


def as_0_1(run: Path) -> None:
    """Make a run what version 0.1 would have stored."""
    with xr.open_datatree((run / "posterior.nc").read_bytes(), engine="h5netcdf") as tree:
        draws = tree.load()
    fixed = draws["constant_data"].to_dataset()
    fixed.attrs.clear()
    dropped = [name for name in fixed.data_vars if str(name).startswith(("scan_", "dhr_rep"))]
    draws["constant_data"] = xr.DataTree(fixed.drop_vars(dropped))
    content = bytes(draws.to_netcdf(engine="h5netcdf"))
    (run / "posterior.nc").write_bytes(content)
    summary = json.loads((run / "summary.json").read_text(encoding="utf-8"))
    del summary["files"]
    summary["posterior_sha256"] = hashlib.sha256(content).hexdigest()
    (run / "summary.json").write_text(json.dumps(summary), encoding="utf-8")


def test_a_run_of_version_0_1_is_read_or_refused_by_its_version(
    run: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    as_0_1(run)
    found = load_analysis(run)
    assert set(found.summary["files"]) == {"posterior.nc"}
    assert main(["report", str(run)]) == 0
    assert main(["predict", str(run), "--theta-i", "20"]) == 2
    assert found.summary["versions"]["pbrdf-bayes"] in capsys.readouterr().err
    (run / "posterior.nc").write_bytes(b"cut")
    assert main(["report", str(run)]) == 2


LIMITS = '[[limit]]\nname = "a"\nparameter = "n"\nupper = 2.0\n'


@pytest.mark.parametrize("name", ["posterior.nc", "config.toml"])
@pytest.mark.parametrize("how", ["missing", "cut", "empty", "altered"])
def test_whatever_reads_a_run_finds_its_damage(
    name: str, how: str, run: Path, small_csv: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Report, predict, design, conform refuse it, as the run and as the reference; nothing else."""
    limits = run.parent / "limits.toml"
    limits.write_text(LIMITS)
    damage(run / name, how)
    before = {path.name: path.read_bytes() for path in run.iterdir()}
    with pytest.raises(RunFolderError, match=re.escape(name)):
        load_analysis(run)
    difference = limits.with_name("difference.toml")
    difference.write_text(LIMITS.replace("limit", "difference").replace("upper", "tolerance"))
    for arguments in (
        ["report", run], ["predict", run], ["design", run], ["conform", run, "--limits", limits],
        ["fit", small_csv, "--out", run.parent / "new", "--limits", difference, "--reference", run],
    ):  # fmt: skip
        assert main([str(word) for word in arguments]) == 2
        told = capsys.readouterr().err
        assert f"{run}: the run is damaged ({name} " in told
        assert "--resume" in told
    assert {path.name: path.read_bytes() for path in run.iterdir()} == before
    assert not (run.parent / "new").exists()


@pytest.mark.parametrize(
    ("name", "how"),
    [("posterior.nc", "missing"), ("posterior.nc", "cut"), ("posterior.nc", "altered"),
     ("config.toml", "altered")],
)  # fmt: skip
def test_resume_fits_a_damaged_run_again_and_says_so(
    name: str, how: str, run: Path, small_csv: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Also where progress is quiet; the draws are those that were lost."""
    before = load_analysis(run)
    damage(run / name, how)
    arguments = ["fit", str(small_csv), "--accuracy", "draft", "--out", str(run), "--resume"]
    assert main([*arguments, "--seed", "2"]) == 2  # another run is not replaced
    assert main([*arguments, "--quiet"]) == 0
    told = capsys.readouterr()
    assert told.out == f"{run}\n"
    notice = told.err.splitlines()[-1]
    assert f"{name} " in notice
    assert "fitted again" in notice
    assert notice.removeprefix("pbrdf-bayes fit: ") in (run / "log.txt").read_text("utf-8")
    again = load_analysis(run)
    xr.testing.assert_identical(
        again.draws["posterior"].to_dataset(), before.draws["posterior"].to_dataset()
    )
    stored = (run / "summary.json").stat().st_mtime_ns
    assert main([*arguments, "--quiet"]) == 0
    assert capsys.readouterr().err == ""
    assert (run / "summary.json").stat().st_mtime_ns == stored


# --------------------------------------------------------------------------------------- atomicity


def test_a_text_is_replaced_whole(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    write_text(path, "première\n")
    write_text(path, "second\n")
    assert path.read_bytes() == b"second\n"
    assert [p.name for p in tmp_path.iterdir()] == ["a.txt"]


@pytest.mark.parametrize("fault", ["replace", "fsync", "mkstemp"])
def test_a_failed_write_leaves_what_was_there(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, fault: str
) -> None:
    path = tmp_path / "a.txt"
    write_text(path, "before")

    def fail(*_: Any, **__: Any) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    owner = run_folder.tempfile if fault == "mkstemp" else os
    with monkeypatch.context() as patch:
        patch.setattr(owner, fault, fail)
        with pytest.raises(RunFolderError, match=r"a\.txt: cannot be written \(No space left"):
            write_text(path, "after")
    assert path.read_text(encoding="utf-8") == "before"
    assert [p.name for p in tmp_path.iterdir()] == ["a.txt"]


@pytest.mark.parametrize("n_good", range(5))
def test_a_run_that_fails_to_be_saved_is_not_finished(
    loaded: Analysis, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, n_good: int
) -> None:
    """Whichever of the five files cannot be moved into place: no summary, no leftovers."""
    moved: list[str] = []
    replace = os.replace

    def sometimes(source: Any, target: Any) -> None:
        if len(moved) == n_good:
            raise OSError(errno.ENOSPC, "No space left on device")
        replace(source, target)
        moved.append(Path(target).name)

    with monkeypatch.context() as patch:
        patch.setattr(os, "replace", sometimes)
        with pytest.raises(RunFolderError, match="cannot be written"):
            save_analysis(loaded, tmp_path, report="r", log="l")
    assert not is_finished(tmp_path)
    assert len(moved) == n_good
    assert {p.name for p in tmp_path.iterdir()} == set(moved)
    assert "summary.json" not in moved
    # the same folder can be completed afterwards
    save_analysis(loaded, tmp_path, report="r", log="l")
    assert load_analysis(tmp_path).summary == loaded.summary


@pytest.mark.skipif(os.name == "nt", reason="POSIX limits")
@pytest.mark.parametrize("limit", [100, 20_000])
def test_files_that_may_not_grow_leave_the_earlier_run(
    run: Path, loaded: Analysis, limit: int
) -> None:
    """As on a full disk, by the system: HDF5 would end the process where it fails to write."""
    import resource

    before = {p.name: p.read_bytes() for p in run.iterdir()}
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limits[1]))
    try:
        with pytest.raises(RunFolderError, match=r"posterior\.nc: cannot be written \(File too"):
            save_analysis(loaded, run, report="r", log="l")
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert {p.name: p.read_bytes() for p in run.iterdir()} == before


def test_the_summary_is_written_last(
    loaded: Analysis, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    order: list[str] = []
    replace = os.replace

    def record(source: Any, target: Any) -> None:
        order.append(Path(target).name)
        replace(source, target)

    monkeypatch.setattr(os, "replace", record)
    save_analysis(loaded, tmp_path, report="r", log="l")
    assert set(order) == FILES
    assert order[-1] == "summary.json"


@pytest.fixture
def unprivileged() -> Iterator[None]:
    """Without the rights of root, for whom no folder is closed."""
    if os.name == "nt":
        pytest.skip("POSIX permissions")
    if os.geteuid() != 0:
        yield
        return
    os.seteuid(65534)
    yield
    os.seteuid(0)


def test_a_folder_that_cannot_be_written(tmp_path: Path, unprivileged: None) -> None:
    closed = Path("/")  # closed to everybody but root
    with (
        pytest.raises(RunFolderError, match=r"cannot write there \(.*\)\. Give another folder"),
        locked(closed / "no_such_run"),
    ):
        pytest.fail("locked a folder that cannot be made")
    with pytest.raises(RunFolderError, match=r"cannot be written"):
        write_text(closed / "no_such_file.txt", "x")
    assert not (closed / "no_such_file.txt").exists()


def test_a_folder_that_cannot_be_made(tmp_path: Path) -> None:
    """A file stands in the way: the same for every user."""
    (tmp_path / "file").write_text("", encoding="utf-8")
    with (
        pytest.raises(RunFolderError, match=r"cannot write there .*Give another folder with --out"),
        locked(tmp_path / "file" / "run"),
    ):
        pytest.fail("locked a folder that cannot be made")
    with pytest.raises(RunFolderError, match=r"cannot be written"):
        write_text(tmp_path / "nowhere" / "a.txt", "x")


# --------------------------------------------------------------------------------------- the lock

HOLDER = """
import sys
from pathlib import Path
from pbrdf_bayes.io.run_folder import locked
with locked(Path(sys.argv[1])):
    print("held", flush=True)
    sys.stdin.read()
"""


@pytest.fixture
def holder(tmp_path: Path) -> Iterator[subprocess.Popen[str]]:
    """Another process that holds tmp_path/run."""
    process = subprocess.Popen(
        [sys.executable, "-c", HOLDER, str(tmp_path / "run")],
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
    )  # fmt: skip
    assert process.stdout is not None
    assert process.stdout.readline() == "held\n"
    yield process
    process.kill()
    process.communicate()


def test_a_second_process_is_refused_until_the_first_ends(
    tmp_path: Path, holder: subprocess.Popen[str]
) -> None:
    folder = tmp_path / "run"
    with (
        pytest.raises(RunFolderError, match=r"another process is writing this run"),
        locked(folder),
    ):
        pytest.fail("two processes hold one folder")
    holder.kill()  # as after a crash: nothing is tidied up
    holder.wait(timeout=30)
    with locked(folder):
        assert (folder / ".lock").exists()


def test_the_lock_is_given_back_after_an_error(tmp_path: Path) -> None:
    with pytest.raises(KeyError), locked(tmp_path):
        raise KeyError
    with locked(tmp_path):
        pass


@pytest.mark.skipif(os.name == "nt", reason="flock")
@pytest.mark.parametrize("code", [errno.ENOLCK, errno.ENOSYS, errno.EOPNOTSUPP, errno.EACCES])
def test_a_file_system_that_cannot_lock_is_not_another_process(
    code: int, run: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    import fcntl

    def fail(*_: object) -> None:
        raise OSError(code, os.strerror(code))

    monkeypatch.setattr(fcntl, "flock", fail)
    assert main(["report", str(run)]) == 2
    told = capsys.readouterr().err
    assert os.strerror(code) in told
    assert "another process is writing" not in told
    assert f"{GO_ON}=1" in told
    monkeypatch.setenv(GO_ON, "1")
    assert main(["report", str(run)]) == 0
    with only_one_at_a_time(run / "other.lock"):  # goes on by itself
        pass


@pytest.mark.skipif(os.name == "nt", reason="flock")
def test_a_lock_that_is_held_is_not_waived(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import fcntl

    def fail(*_: object) -> None:
        raise OSError(errno.EWOULDBLOCK, os.strerror(errno.EWOULDBLOCK))

    monkeypatch.setattr(fcntl, "flock", fail)
    monkeypatch.setenv(GO_ON, "1")
    with pytest.raises(RunFolderError, match="another process"), locked(tmp_path):
        pytest.fail("locked")


def test_a_lock_inside_a_lock_is_refused(tmp_path: Path) -> None:
    with (
        locked(tmp_path),
        pytest.raises(RunFolderError, match="another process"),
        locked(tmp_path),
    ):
        pytest.fail("locked twice")


# -------------------------------------------------------------------------------------- the names


def test_a_new_folder_is_named_by_sample_and_time(tmp_path: Path) -> None:
    first = new_run_folder(tmp_path, "green/paint")
    assert first.parent == tmp_path / safe_name("green/paint")
    first.mkdir(parents=True)
    second = new_run_folder(tmp_path, "green/paint")
    assert second != first
    assert second.parent == first.parent


HOSTILE = [
    "", ".", "..", "../../etc/passwd", "/etc/passwd", "a/b", "a\\b", "C:\\x", "con", "CON.txt", "nul",
    "com1", "-rf", "--out", "~root", "$HOME", "`x`", "a b", "a\nb", "a\x00b", "\u202egpj.exe", "é", "ｅ",
    "x" * 500, " ", "🎨", "a.", "a ", "\ud800", "<script>", "%2e%2e", ".hidden", "paint\t1",
]  # fmt: skip


def is_safe(name: str) -> bool:
    plain = name.isascii() and all(c.isalnum() or c in "._-" for c in name)
    reserved = {"con", "prn", "aux", "nul"} | {f"{d}{i}" for d in ("com", "lpt") for i in range(10)}
    return (
        plain and 0 < len(name) <= 100 and name[0] not in ".-" and name[-1] not in ".-"
        and name.lower().split(".")[0] not in reserved
    )  # fmt: skip


@pytest.mark.parametrize("name", HOSTILE)
def test_hostile_names_become_harmless(name: str) -> None:
    assert is_safe(safe_name(name)), safe_name(name)


@given(st.text(max_size=120))
@settings(max_examples=400, deadline=None)
@example("con-" + "x" * 8)
@example("COM1.tar.gz")
@example("a" * 81)
def test_any_name_becomes_one_harmless_path_component(name: str) -> None:
    found = safe_name(name)
    assert is_safe(found), found
    assert Path(found).name == found
    assert safe_name(name) == found


@given(st.text(max_size=40), st.text(max_size=40))
@settings(max_examples=400, deadline=None)
def test_different_names_never_share_a_folder(first: str, second: str) -> None:
    if first != second:
        assert safe_name(first) != safe_name(second)


@pytest.mark.parametrize(
    ("first", "second"),
    [("a/b", "a\\b"), ("é", "e\u0301"), ("x" * 90, "x" * 91), ("a ", "a"), ("a.", "a")],
)
def test_names_that_look_alike_do_not_share_a_folder(first: str, second: str) -> None:
    assert safe_name(first) != safe_name(second)


# ------------------------------------------------------------------------------------ small parts


def test_plain_values_leave_nothing_that_json_lacks() -> None:
    value = {
        "nan": np.nan, "inf": [np.inf, -np.inf], "scalar": np.float32(0.5), "int": np.int64(3),
        "flag": np.bool_(True), "text": "x", "none": None, "tuple": (1, np.nan),
    }  # fmt: skip
    found = plain(value)
    assert json.loads(json.dumps(found, allow_nan=False)) == {
        "nan": None, "inf": [None, None], "scalar": 0.5, "int": 3, "flag": True, "text": "x",
        "none": None, "tuple": [1, None],
    }  # fmt: skip


def test_errors_of_the_run_folder_are_ours() -> None:
    assert issubclass(RunFolderError, pb.PbrdfError)
    assert issubclass(RunFolderError, OSError)
    assert RunFolderError.exit_code == 2


@pytest.mark.parametrize("raised", [AttributeError, KeyError, RuntimeError, TypeError])
def test_whatever_a_damaged_file_makes_the_reader_raise_is_one_error(
    finished_run, monkeypatch, raised
):
    """A flipped byte in a netCDF file comes out of its readers in many ways."""

    def fail(*_args, **_options):
        raise raised("no attribute")

    monkeypatch.setattr(run_folder.xr, "open_datatree", fail)
    with pytest.raises(RunFolderError, match=r"damaged .*--resume"):
        load_analysis(finished_run)

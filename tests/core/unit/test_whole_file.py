"""The one writer of files: links, devices, modes, owners, folders, and a disk that is full."""

from __future__ import annotations

import os
import resource
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from matplotlib.figure import Figure

from patagium.errors import OutputError, ParameterError, command
from patagium.netcdf_file import NetcdfDraft
from patagium.report.figures import save_figure
from patagium.whole_file import locked, make_folder, whole_file, write_whole


def drafts(folder: Path) -> list[Path]:
    return [one for one in folder.rglob("*") if one.name.endswith(".part")]


@contextmanager
def longest_file(size: int) -> Iterator[None]:
    """No file of this process grows beyond a size [B]; writing fails as on a full disk."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


def test_text_that_is_none_is_refused_and_the_file_stays(tmp_path: Path) -> None:
    """A lone half of a character, as a name of a strange file system gives."""
    path = tmp_path / "page.md"
    path.write_text("before")
    with pytest.raises(ParameterError, match="^text of .*page.md: expected characters that UTF-8"):
        write_whole(path, "a name: wing\ud800")
    assert path.read_text() == "before" and not drafts(tmp_path)


def test_a_link_stays_and_its_file_is_replaced(tmp_path: Path) -> None:
    (tmp_path / "far").mkdir()
    real, link, chain = tmp_path / "far" / "real.txt", tmp_path / "link", tmp_path / "chain"
    real.write_text("old")
    link.symlink_to("far/real.txt")
    chain.symlink_to(link)
    assert write_whole(chain, "new") == chain
    assert link.is_symlink() and chain.is_symlink() and not real.is_symlink()
    assert real.read_text() == "new"
    assert not drafts(tmp_path)


def test_a_link_to_nothing_makes_its_file_and_a_circle_is_refused(tmp_path: Path) -> None:
    link, circle = tmp_path / "link", tmp_path / "circle"
    link.symlink_to("made.txt")
    write_whole(link, "new")
    assert link.is_symlink() and (tmp_path / "made.txt").read_text() == "new"
    circle.symlink_to(circle)
    with pytest.raises(OutputError, match="circle: cannot be written: .*links"):
        write_whole(circle, "new")


def test_a_file_keeps_its_mode_and_a_new_one_obeys_the_umask(tmp_path: Path) -> None:
    secret, new = tmp_path / "secret", tmp_path / "new"
    secret.touch(0o600)
    secret.chmod(0o600)
    with whole_file(secret) as draft:
        assert draft.stat().st_mode & 0o777 == 0o600, "readable by others while it is written"
        draft.write_text("new")
    assert secret.stat().st_mode & 0o777 == 0o600
    before = os.umask(0o027)
    try:
        write_whole(new, "new")
    finally:
        os.umask(before)
    assert new.stat().st_mode & 0o777 == 0o640


@pytest.mark.skipif(os.geteuid() != 0, reason="only root gives files away")
def test_a_file_keeps_its_owner(tmp_path: Path) -> None:
    file = tmp_path / "file"
    file.touch()
    os.chown(file, 1234, 2345)
    write_whole(file, "new")
    assert (file.stat().st_uid, file.stat().st_gid) == (1234, 2345)


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write everywhere")
def test_a_file_that_may_not_be_written_is_not_replaced(tmp_path: Path) -> None:
    file = tmp_path / "file"
    file.write_text("old")
    file.chmod(0o400)
    with pytest.raises(OutputError, match="may be written"):
        write_whole(file, "new")
    assert file.read_text() == "old"


def test_a_draft_that_is_open_is_not_abandoned(tmp_path: Path) -> None:
    """A stream with few packets writes rarely, and another process removed its open file."""
    slow = NetcdfDraft(tmp_path / "stream.nc")
    os.utime(slow.path, (1e9, 1e9))
    write_whole(tmp_path / "stream.nc", "of another process")
    assert slow.publish().read_bytes()[1:4] == b"HDF" and not drafts(tmp_path)


def test_a_folder_that_is_not_there_is_not_made(tmp_path: Path) -> None:
    with pytest.raises(OutputError, match=r"mkdir -p .*/a$"):
        write_whole(tmp_path / "a" / "file", "new")
    with pytest.raises(OutputError, match=r"mkdir -p .*/a$"):
        make_folder(tmp_path / "a" / "b")
    assert not list(tmp_path.iterdir())
    assert make_folder(make_folder(tmp_path / "a")).is_dir()
    (tmp_path / "file").touch()
    with pytest.raises(OutputError, match="folder"):
        write_whole(tmp_path / "file" / "inner", "new")
    with pytest.raises(OutputError, match="name a file, not a folder"):
        write_whole(tmp_path / "a", "new")


def test_the_folder_behind_a_link_is_the_one_to_make(tmp_path: Path) -> None:
    """A link to nowhere was answered by: make the link's own folder, which was there."""
    link = tmp_path / "link"
    link.symlink_to(tmp_path / "far" / "file")
    with pytest.raises(OutputError, match=r"mkdir -p .*/far$"):
        write_whole(link, "new")


def test_a_name_is_no_option_of_a_proposed_command() -> None:
    """A command with the name of a file "-a.nc" failed: no such option."""
    assert command("view {} --model {}", "-a.nc", "b c") == "view ./-a.nc --model 'b c'"


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full on this system")
def test_a_device_is_written_to_and_stays(tmp_path: Path) -> None:
    before = os.lstat("/dev/full")
    with pytest.raises(OutputError, match="/dev/full: cannot be written: No space left"):
        write_whole("/dev/full", "new")
    link = tmp_path / "link"
    link.symlink_to("/dev/null")
    write_whole(link, "new")
    assert os.path.samestat(os.lstat("/dev/full"), before)
    assert link.is_symlink() and not Path("/dev/null").is_file()


def test_a_device_is_not_locked() -> None:
    """A lock file was made in /dev, where most users may not write."""
    with locked("/dev/null"), locked("/dev/null"):
        assert not Path("/dev/.null.lock").exists()


def test_a_pipe_gets_the_content_and_stays(tmp_path: Path) -> None:
    pipe, heard = tmp_path / "pipe", []
    os.mkfifo(pipe)
    reader = threading.Thread(target=lambda: heard.append(pipe.read_bytes()))
    reader.start()
    write_whole(pipe, "new")
    reader.join(10.0)
    assert heard == [b"new"] and pipe.is_fifo()


@pytest.mark.parametrize("name", ["/dev/stdout", "/dev/fd/1", "/proc/self/fd/1"])
def test_standard_output_is_written_in_order_and_not_replaced(tmp_path: Path, name: str) -> None:
    if not Path(name).exists():
        pytest.skip(f"no {name} on this system")
    words = (
        "import sys; from patagium.whole_file import write_whole; print('before'); "
        f"write_whole({name!r}, 'content\\n'); print('after')"
    )
    out = tmp_path / "out"
    with out.open("wb") as stream:
        subprocess.run([sys.executable, "-c", words], stdout=stream, check=True)
    assert out.read_text() == "before\ncontent\nafter\n"
    piped = subprocess.run([sys.executable, "-c", words], capture_output=True, check=True)
    assert piped.stdout == b"before\ncontent\nafter\n"


@pytest.mark.parametrize("size", [0, 1, 4095, 20_000])
def test_a_full_disk_leaves_the_old_file_and_says_so(tmp_path: Path, size: int) -> None:
    file = tmp_path / "file"
    file.write_text("old")
    with longest_file(size), pytest.raises(OutputError, match="file: cannot be .*; free space"):
        write_whole(file, bytes(30_000))
    assert file.read_text() == "old" and not drafts(tmp_path)


@pytest.mark.parametrize("kind", ["pdf", "svg", "png"])
def test_a_figure_says_so_too(tmp_path: Path, kind: str) -> None:
    """matplotlib's PDF writer hides a failed write behind an error of its compressor."""
    figure, file = Figure(), tmp_path / f"figure.{kind}"
    figure.add_subplot().plot(np.random.default_rng(1).normal(size=3000))
    file.write_text("old")
    with longest_file(8192), pytest.raises(OutputError, match="too large; free space"):
        save_figure(figure, file)
    assert file.read_text() == "old" and not drafts(tmp_path)


def test_netcdf_says_why_a_full_disk_does_not_take_it(tmp_path: Path) -> None:
    file, record = tmp_path / "file.nc", xr.Dataset({"x": ("time", [1.0] * 100_000)})
    file.write_text("old")
    with longest_file(50_000), pytest.raises(OutputError, match="too large; free space"):
        with whole_file(file) as draft:
            record.to_netcdf(draft, engine="netcdf4")
    assert file.read_text() == "old" and not drafts(tmp_path)


def test_what_fails_to_be_read_meanwhile_is_told_as_it_is(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match="elsewhere"), whole_file(tmp_path / "file"):
        Path("/elsewhere/none").read_text()
    assert not list(tmp_path.iterdir())


@pytest.mark.skipif(sys.platform != "linux", reason="names that are no text")
def test_a_name_that_is_no_text_is_refused_by_netcdf(tmp_path):
    with pytest.raises(OutputError, match="no text in UTF-8"):
        NetcdfDraft(tmp_path / os.fsdecode(b"\xff.nc"))
    assert list(tmp_path.iterdir()) == []

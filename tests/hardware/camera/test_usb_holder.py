import os
import subprocess
import sys
from pathlib import Path

import pytest

from hardware.camera import usb_holder
from hardware.holders import Holder, holders

PORT = "usb:001,005"


@pytest.fixture
def bus(tmp_path: Path) -> Path:
    (tmp_path / "bus" / "001").mkdir(parents=True)
    (tmp_path / "bus" / "001" / "005").write_bytes(b"")
    return tmp_path / "bus"


def process(proc: Path, number: int, command: str, *opened: Path) -> None:
    """One entry of /proc."""
    (proc / str(number) / "fd").mkdir(parents=True)
    for handle, path in enumerate(opened):
        (proc / str(number) / "fd" / str(handle)).symlink_to(path)
    (proc / str(number) / "cmdline").write_bytes(command.replace(" ", "\0").encode())
    (proc / str(number) / "comm").write_text(
        f"{Path(command.split()[0]).name[:15]}\n" if command else "kworker\n"
    )


def test_a_real_process_that_holds_it_is_named(bus: Path):
    code = "import sys, time; f = open(sys.argv[1]); print(flush=True); time.sleep(60)"
    holder = subprocess.Popen([sys.executable, "-c", code, bus / "001" / "005"], stdout=subprocess.PIPE)
    try:
        assert holder.stdout is not None
        holder.stdout.readline()
        (found,) = holders(bus / "001" / "005")
        assert found.process == holder.pid
        assert "python" in found.name
        assert f"process {holder.pid}" in usb_holder.in_use(PORT, bus=bus)
    finally:
        holder.kill()
        holder.wait()


def test_the_desktops_importer_is_named_with_what_makes_it_let_go(bus: Path, tmp_path: Path):
    proc = tmp_path / "proc"
    process(proc, 9, "/usr/libexec/gvfsd-gphoto2 --spawner :1.7", bus / "001" / "005")
    process(proc, 10, "/usr/bin/bash", Path("/dev/null"))
    process(proc, 11, "/usr/bin/other", bus / "001" / "006")
    assert holders(bus / "001" / "005", proc) == (Holder(9, "gvfsd-gphoto2"),)
    told = usb_holder.in_use(PORT, proc, bus)
    assert "gvfsd-gphoto2 (process 9)" in told
    assert "gio mount -s gphoto2" in told


def test_any_other_program_is_to_be_closed(bus: Path, tmp_path: Path):
    proc = tmp_path / "proc"
    process(proc, 77, "/usr/bin/darktable", bus / "001" / "005")
    assert "darktable (process 77): close that program" in usb_holder.in_use(PORT, proc, bus)


def test_this_program_itself_is_not_told_to_close_itself(bus: Path):
    with (bus / "001" / "005").open():
        assert [holder.process for holder in holders(bus / "001" / "005")] == [os.getpid()]
        assert "this program itself" in usb_holder.in_use(PORT, bus=bus)


def test_a_program_of_somebody_else_stays_hidden_and_is_said_to(bus: Path, tmp_path: Path):
    (tmp_path / "proc" / "12").mkdir(parents=True)  # no fd to look into, and one that ended while we looked
    told = usb_holder.in_use(PORT, tmp_path / "proc", bus)
    assert f"sudo fuser -v {bus}/001/005" in told


@pytest.mark.parametrize("port", ["ptpip:192.168.0.7", "usb:", "serial:/dev/ttyS0", ""])
def test_ports_without_a_device_file_have_no_holders(port: str):
    assert usb_holder.device(port) is None
    assert usb_holder.in_use(port)

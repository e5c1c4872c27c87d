"""Runs one command in a throw-away virtual machine that has a real video device: Debian's kernel with `vivid`.

The guest sees this machine's files, read-only, so the same Python serves; /mnt it may write. No root rights, no image
of a disk, no network, no KVM. Needed: `apt install qemu-system-x86 busybox-static kmod`, and once the network, to
fetch the kernel.

    python -m tests.vm.vivid_vm CACHE -- COMMAND...

Exit status: the command's own; 125 if the guest told none; 124 when out of time.
"""

import os
import shlex
import shutil
import stat
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

PACKAGES = "qemu-system-x86 busybox-static kmod"
TOLD_NOTHING, OUT_OF_TIME = 125, 124
_MODULES = ("virtio_pci", "9pnet_virtio", "9p", "vivid")
# One capture node with one webcam as its input, in the single-planar interface that cameras have.
_VIVID = "n_devs=1 node_types=0x1 num_inputs=1 input_types=0x0 multiplanar=1 vid_cap_nr=0"
_9P = "trans=virtio,version=9p2000.L,msize=524288"
_COMMAND, _STATUS = ".command", ".status"
_INIT = f"""#!/bin/busybox sh
B=/bin/busybox
$B mkdir -p /proc /sys /dev /root
$B mount -t proc proc /proc
$B mount -t sysfs sys /sys
$B mount -t devtmpfs dev /dev
while read m; do $B insmod /mods/$m; done < /mods/order
$B insmod /mods/vivid.ko {_VIVID}
$B mount -t 9p -o ro,cache=loose,{_9P} host /root || $B poweroff -f
$B mount -t proc proc /root/proc
$B mount -t sysfs sys /root/sys
$B mount -t devtmpfs dev /root/dev
$B mkdir -p /dev/shm
$B mount -t tmpfs shm /root/dev/shm
$B mount -t tmpfs tmp /root/mnt
$B mkdir /root/mnt/share
$B mount -t 9p -o rw,{_9P} share /root/mnt/share
$B ip link set lo up
$B chroot /root /bin/sh /mnt/share/{_COMMAND}
echo $? > /root/mnt/share/{_STATUS}
$B sync
$B poweroff -f
"""


def is_installed() -> bool:
    """Return whether all programs are there."""
    return (
        all(_program(name) for name in ("qemu-system-x86_64", "depmod", "dpkg-deb")) and Path("/bin/busybox").exists()
    )


def prepare(cache: Path) -> tuple[Path, Path]:
    """Return kernel and first file system, fetched and made if they are not there yet."""
    cache.mkdir(parents=True, exist_ok=True)
    tree = cache / "kernel"
    if not list(tree.glob("boot/vmlinuz-*")):
        _fetch_kernel(cache, tree)
    first = cache / "initramfs"
    if not first.exists():
        _make_first_file_system(tree, first)
    return next(tree.glob("boot/vmlinuz-*")), first


def run(cache: Path, command: Sequence[str], *, timeout_s: float = 300.0) -> int:
    """Return the exit status of a command in the guest; its output goes to ours."""
    kernel, first = prepare(cache)
    with tempfile.TemporaryDirectory(prefix="vivid-") as folder:
        share = Path(folder)
        (share / _COMMAND).write_text(
            f"export HOME=/mnt TMPDIR=/mnt PYTHONDONTWRITEBYTECODE=1 PATH={shlex.quote(os.environ['PATH'])}\n"
            f"cd {shlex.quote(str(Path.cwd()))} && {shlex.join(command)}\n"
        )
        try:
            subprocess.run(_qemu(kernel, first, share), stdin=subprocess.DEVNULL, timeout=timeout_s, check=False)
        except subprocess.TimeoutExpired:
            return OUT_OF_TIME
        status = share / _STATUS
        return int(status.read_text()) if status.exists() else TOLD_NOTHING


def _qemu(kernel: Path, first: Path, share: Path) -> list[str]:
    quiet = "console=ttyS0 quiet loglevel=3 panic=-1 edd=off mitigations=off random.trust_cpu=on nokaslr"
    shared = "security_model=none"
    return [
        "qemu-system-x86_64",
        *("-accel", "tcg,thread=multi", "-cpu", "max", "-smp", "2", "-m", "1024", "-machine", "pc"),
        *("-nodefaults", "-no-user-config", "-no-reboot", "-display", "none", "-serial", "stdio"),
        *("-kernel", str(kernel), "-initrd", str(first), "-append", quiet),
        *("-virtfs", f"local,path=/,mount_tag=host,{shared},readonly=on,multidevs=remap"),
        *("-virtfs", f"local,path={share},mount_tag=share,{shared}"),
    ]


def _fetch_kernel(cache: Path, tree: Path) -> None:
    depends = _output("apt-cache", "depends", "linux-image-amd64")
    name = next(line.split()[-1] for line in depends.splitlines() if "Depends: linux-image-" in line)
    _output("apt-get", "-qq", "download", name, folder=cache)
    package = next(cache.glob("linux-image-*.deb"))
    _output("dpkg-deb", "-x", str(package), str(tree))
    package.unlink()


def _make_first_file_system(tree: Path, first: Path) -> None:
    version = next((tree / "lib/modules").iterdir()).name
    _output(_program("depmod") or "depmod", "-b", str(tree), version)
    base = tree / "lib/modules" / version
    order = _load_order((base / "modules.dep").read_text())
    plain = [Path(module).name for module in order if not module.endswith("/vivid.ko")]
    folder, program = stat.S_IFDIR | 0o755, stat.S_IFREG | 0o755
    entries = [(name, folder, b"") for name in ("bin", "mods", "dev")]
    entries += [
        ("bin/busybox", program, Path("/bin/busybox").read_bytes()),
        ("init", program, _INIT.encode()),
        ("mods/order", program, "".join(f"{name}\n" for name in plain).encode()),
    ]
    entries += [(f"mods/{Path(module).name}", program, (base / module).read_bytes()) for module in order]
    first.write_bytes(_archive(entries))


def _load_order(dependencies: str) -> list[str]:
    """Return the modules' files, each after those that it needs."""
    needs = {file: rest.split() for file, _, rest in (line.partition(":") for line in dependencies.splitlines())}
    by_name = {Path(file).stem.replace("-", "_"): file for file in needs}
    order: list[str] = []
    for module in _MODULES:
        file = by_name[module.replace("-", "_")]
        order += [part for part in (*reversed(needs[file]), file) if part not in order]
    return order


def _archive(entries: list[tuple[str, int, bytes]]) -> bytes:
    """Return a cpio archive of the kind that kernels read ("newc")."""
    out = bytearray()
    for number, (name, mode, data) in enumerate([*entries, ("TRAILER!!!", 0, b"")], start=1):
        raw = name.encode() + b"\0"
        fields = (number, mode, 0, 0, 1, 0, len(data), 0, 0, 0, 0, len(raw), 0)
        out += b"070701" + b"".join(b"%08X" % field for field in fields) + raw
        out += b"\0" * (-len(out) % 4)
        out += data
        out += b"\0" * (-len(out) % 4)
    return bytes(out)


def _program(name: str) -> str | None:
    return shutil.which(name, path=f"{os.environ['PATH']}:/sbin:/usr/sbin")


def _output(*command: str, folder: Path | None = None) -> str:
    return subprocess.run(command, check=True, text=True, stdout=subprocess.PIPE, cwd=folder).stdout


if __name__ == "__main__":
    if len(sys.argv) < 4 or sys.argv[2] != "--":
        sys.exit(__doc__)
    sys.exit(run(Path(sys.argv[1]), sys.argv[3:]))

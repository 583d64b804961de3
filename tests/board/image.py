"""The virtual board's image: Debian's own arm64 kernel with an initramfs, made from packages that apt fetches.

Everything lies in a cache folder (RELUME_BOARD_CACHE, else target/board-cache of the repository), named by content: a new
kernel or a changed `init` makes a new image beside the old one. Needs apt-get, dpkg-deb and the architecture arm64; no root.
"""

import hashlib
import json
import lzma
import os
import re
import shutil
import subprocess
import tempfile
from dataclasses import dataclass
from pathlib import Path

from fault import BoardError

HERE = Path(__file__).resolve().parent
TRIPLE = "aarch64-linux-gnu"
# In the order of loading; what they depend on comes first by itself.
MODULES = "virtio_pci virtio_console 9pnet_virtio 9p virtio_gpu uvcvideo vhci_hcd vivid".split()
# A program for devices is linked with the last five and what they need.
PACKAGES = "busybox-static libc6 libgcc-s1 libgbm1 libdrm2 libwayland-server0 libexpat1 libffi8".split()
LIBRARIES = (
    "libc.so.6 libm.so.6 libpthread.so.0 libdl.so.2 librt.so.1 libgcc_s.so.1 "
    "libgbm.so.1 libdrm.so.2 libwayland-server.so.0 libexpat.so.1 libffi.so.8"
).split()


@dataclass(frozen=True)
class Image:
    """A kernel, its initramfs, and a folder with Mesa or None."""

    kernel: Path
    initramfs: Path
    mesa: Path | None = None


def cache_folder():
    """Where images are kept unless the caller says otherwise."""
    return Path(os.environ.get("RELUME_BOARD_CACHE") or HERE.parents[1] / "target/board-cache")


def build_image(cache=None, mesa="none", modules=None):
    """Makes the image, or takes it from the cache. `mesa`: none, or stub (software rendering through gbm)."""
    cache = Path(cache or cache_folder()).resolve()
    modules = list(modules or MODULES)
    packages = known_packages(cache, "board", lambda: [kernel_package()] + PACKAGES)
    recipe = [[p.sha256 for p in packages], modules, LIBRARIES, (HERE / "init").read_text(), Path(__file__).read_text()]
    folder = cache / f"image-{key(recipe)}"
    if not folder.exists():
        with fresh_folder(cache) as work:
            unpack(packages, cache, work / "root")
            (kernel,) = (work / "root/boot").glob("vmlinuz-*")
            made = work / "made"
            made.mkdir()
            shutil.copy(kernel, made / "vmlinuz")
            (made / "initramfs").write_bytes(initramfs(work / "root", modules))
            publish(made, folder)
    if mesa == "none":
        return Image(folder / "vmlinuz", folder / "initramfs")
    import mesa as stub  # needs a cross compiler: only for those who ask for it

    return Image(folder / "vmlinuz", folder / "initramfs", stub.build(cache))


def key(recipe):
    """A name for what is made from a recipe."""
    return hashlib.sha256(json.dumps(recipe).encode()).hexdigest()[:16]


class fresh_folder:
    """A folder to work in beside the cache's finished ones; gone afterwards."""

    def __init__(self, cache):
        cache.mkdir(parents=True, exist_ok=True)
        self.path = Path(tempfile.mkdtemp(prefix="work-", dir=cache))

    def __enter__(self):
        return self.path

    def __exit__(self, *_):
        shutil.rmtree(self.path, ignore_errors=True)


def publish(made, folder):
    """Moves a finished folder to its place; another process may have been quicker."""
    try:
        made.rename(folder)
    except OSError:
        if not folder.exists():
            raise


# ---- packages


@dataclass(frozen=True)
class Package:
    """A package file as apt knows it."""

    name: str
    file: str
    sha256: str


def run(*command, **options):
    """Output of a program; a failure is one line."""
    try:
        return subprocess.run(command, check=True, capture_output=True, text=True, **options).stdout
    except FileNotFoundError as error:
        raise BoardError(f"{command[0]} is missing: the virtual board needs a Debian system") from error
    except subprocess.CalledProcessError as error:
        last = (error.stderr.strip().splitlines() or ["no reason given"])[-1]
        raise BoardError(f"{' '.join(command[:3])}: {last}") from error


def known_packages(cache, what, names):
    """The packages that `names()` gives; asks apt, which takes seconds, only when its lists have changed."""
    lists = Path("/var/lib/apt/lists")
    state = [lists.stat().st_mtime_ns if lists.exists() else 0, hashlib.sha256(Path(__file__).read_bytes()).hexdigest()]
    memory = cache / f"{what}-packages.json"
    try:
        known = json.loads(memory.read_text())
        if known["state"] == state:
            return [Package(*fields) for fields in known["packages"]]
    except (OSError, ValueError, KeyError, TypeError):
        pass  # not there yet, or cut short: ask again
    packages = resolve(names())
    cache.mkdir(parents=True, exist_ok=True)
    memory.write_text(json.dumps({"state": state, "packages": [list(vars(p).values()) for p in packages]}))
    return packages


def kernel_package():
    """The package behind the one that always means the newest kernel."""
    found = re.search(r"Depends: (linux-image-\d[^: ]*)", run("apt-cache", "depends", "linux-image-arm64:arm64"))
    if not found:
        raise BoardError("apt knows no linux-image-arm64: dpkg --add-architecture arm64 && apt-get update")
    return found[1]


def resolve(names):
    """Files and hashes of packages for arm64."""
    try:
        told = run("apt-get", "download", "--print-uris", *(f"{name}:arm64" for name in names))
    except BoardError as error:
        raise BoardError(f"{error}; dpkg --add-architecture arm64 && apt-get update") from error
    found = {}
    for file, sha256 in re.findall(r"^'[^']*' (\S+) \d+ SHA256:(\w+)", told, re.MULTILINE):
        found[file.split("_")[0]] = Package(file.split("_")[0], file, sha256)
    missing = [name for name in names if name not in found]
    if missing:
        raise BoardError(f"apt offers no {missing[0]}:arm64 with a hash: apt-get update")
    return [found[name] for name in names]


def file_of(package, cache):
    """Where the package's file is kept."""
    return cache / "packages" / f"{package.sha256[:16]}-{package.name}.deb"


def fetch(packages, cache):
    """Downloads what is not in the cache yet, all at once, as apt takes a second to begin; checks it."""
    missing = [package for package in packages if not file_of(package, cache).exists()]
    if not missing:
        return
    (cache / "packages").mkdir(parents=True, exist_ok=True)
    with fresh_folder(cache) as work:
        run("apt-get", "download", *(f"{package.name}:arm64" for package in missing), cwd=work)
        for package in missing:
            (deb,) = work.glob(f"{package.name}_*.deb")
            if hashlib.sha256(deb.read_bytes()).hexdigest() != package.sha256:
                raise BoardError(f"{package.file}: the download is not what apt announced; try again")
            deb.rename(file_of(package, cache))


def unpack(packages, cache, root):
    """Unpacks packages over each other."""
    fetch(packages, cache)
    for package in packages:
        run("dpkg-deb", "-x", str(file_of(package, cache)), str(root))


# ---- modules


def depends(module):
    """What a module's own section says that it needs."""
    found = re.search(rb"\0depends=([^\0]*)\0", module)
    return found[1].decode().split(",") if found and found[1] else []


def load_order(root, wanted):
    """(wanted, name, content) of modules in an order in which they load, each once."""
    files = {path.name.split(".")[0].replace("-", "_"): path for path in root.glob("lib/modules/*/kernel/**/*.ko*")}
    order, seen = [], set()

    def add(name, reason):
        name = name.replace("-", "_")
        if name in seen:
            return
        seen.add(name)
        if name not in files:
            if name == reason:
                print(f"board: this kernel has no module {name}; it may be built in")
            return
        content = files[name].read_bytes()
        content = lzma.decompress(content) if files[name].suffix == ".xz" else content
        for needed in depends(content):
            add(needed, reason)
        order.append((reason, name, content))

    for name in wanted:
        add(name, name)
    return order


# ---- initramfs


def entry(name, mode, content=b"", number=[0]):
    """A file in cpio's newc format."""
    number[0] += 1
    fields = [number[0], mode, 0, 0, 1, 0, len(content), 0, 0, 0, 0, len(name) + 1, 0]
    header = b"070701" + "".join(f"{field:08x}" for field in fields).encode() + name.encode() + b"\0"
    return header + bytes(-len(header) % 4) + content + bytes(-len(content) % 4)


def library(root, name):
    """Content of a shared library, wherever its package puts it."""
    for folder in (f"usr/lib/{TRIPLE}", f"lib/{TRIPLE}"):
        path = root / folder / name
        if path.exists():
            return path.read_bytes()
    raise BoardError(f"{name} is in none of the packages {' '.join(PACKAGES)}")


def initramfs(root, wanted):
    """The archive that the kernel unpacks at its start."""
    folders = f"bin dev lib lib/{TRIPLE} modules out proc run share sys tmp".split()
    parts = [entry(folder, 0o040755) for folder in folders]
    parts.append(entry("init", 0o100755, (HERE / "init").read_bytes()))
    parts.append(entry("bin/busybox", 0o100755, (root / "bin/busybox").read_bytes()))
    loader = (root / f"lib/{TRIPLE}/ld-linux-aarch64.so.1").read_bytes()
    parts.append(entry("lib/ld-linux-aarch64.so.1", 0o100755, loader))
    parts += [entry(f"lib/{TRIPLE}/{name}", 0o100755, library(root, name)) for name in LIBRARIES]
    lines = []
    for reason, name, content in load_order(root, wanted):
        parts.append(entry(f"modules/{name}.ko", 0o100644, content))
        lines.append(f"{reason} {name} {name}.ko\n")
    parts.append(entry("modules/order", 0o100644, "".join(lines).encode()))
    return b"".join(parts) + entry("TRAILER!!!", 0)

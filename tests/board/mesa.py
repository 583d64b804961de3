"""Mesa for the virtual board, for programs that want buffers of gbm: Debian's own, its 112 MB libLLVM replaced by a stub.

Software rendering by softpipe never calls LLVM, yet the driver file is linked with it. The stub has every symbol that the
driver asks for and nothing behind them. Needs the packages binutils-aarch64-linux-gnu and gcc-aarch64-linux-gnu.
"""

import re
import shutil
from pathlib import Path

import image

PACKAGES = (
    "libgl1-mesa-dri libgbm1 libdrm2 libdrm-amdgpu1 libdrm-nouveau2 libdrm-radeon1 libelf1 libglapi-mesa libsensors5 "
    "libxau6 libxdmcp6 libxcb1 libxcb-dri3-0 libzstd1 zlib1g libbsd0 libmd0 libstdc++6 libwayland-server0 libexpat1 libffi8"
).split()
# All drivers are one file under many names.
DRIVERS = ("swrast", "kms_swrast", "virtio_gpu")
TOOLS = "aarch64-linux-gnu-"


def build(cache):
    """The folder with Mesa's libraries and drivers, from the cache or made now."""
    packages = image.known_packages(cache, "mesa", lambda: PACKAGES)
    recipe = [[p.sha256 for p in packages], Path(__file__).read_text()]
    folder = cache / f"mesa-{image.key(recipe)}"
    if folder.exists():
        return folder
    with image.fresh_folder(cache) as work:
        root, made = work / "root", work / "made"
        image.unpack(packages, cache, root)
        (made / "dri").mkdir(parents=True)
        for library in [*root.glob(f"usr/lib/{image.TRIPLE}/*.so*"), *root.glob(f"lib/{image.TRIPLE}/*.so*")]:
            if library.exists():  # not a link into a package that is left out
                shutil.copy(library, made / library.name)
        driver = made / "dri/swrast_dri.so"
        shutil.copy(root / f"usr/lib/{image.TRIPLE}/dri/swrast_dri.so", driver)
        for name in DRIVERS[1:]:
            (made / f"dri/{name}_dri.so").hardlink_to(driver)
        stub_llvm(driver, made, work)
        image.publish(made, folder)
    return folder


def stub_llvm(driver, into, work):
    """A library under libLLVM's name with the symbols that the driver takes from it."""
    needed = image.run(f"{TOOLS}readelf", "-d", str(driver))
    name = re.search(r"NEEDED.*\[(libLLVM[^\]]*)\]", needed)
    if not name:
        return
    symbols = image.run(f"{TOOLS}nm", "-D", "--undefined-only", str(driver))
    wanted = sorted(set(re.findall(r" (\S+)@(LLVM\S*)$", symbols, re.MULTILINE)))
    versions = {version for _, version in wanted}
    (work / "stub.S").write_text("\n".join(assembly(symbol) for symbol, _ in wanted) + "\n")
    (work / "stub.map").write_text("".join(f"{version} {{ global: *; }};\n" for version in sorted(versions)))
    image.run(f"{TOOLS}gcc", "-shared", "-nostdlib", f"-Wl,-soname,{name[1]}", f"-Wl,--version-script,{work}/stub.map",
              "-o", str(into / name[1]), str(work / "stub.S"))


def assembly(symbol):
    """A symbol: tables of classes and static members are data, all else returns 0."""
    is_data = symbol.startswith(("_ZTV", "_ZTI", "_ZTS")) or re.fullmatch(r"_ZN4llvm.*E", symbol)
    if is_data:
        return f".data\n.globl {symbol}\n.type {symbol},@object\n.size {symbol},512\n{symbol}: .zero 512"
    return f".text\n.globl {symbol}\n.type {symbol},@function\n{symbol}: mov x0, xzr\nret"

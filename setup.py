"""The top-level folders are parts of one import package; everything else is in pyproject.toml."""

from setuptools import find_packages, setup

FOLDERS = {
    "bunraku": "bunraku",
    "bunraku.nodes": "nodes",
    "bunraku.msgs": "msgs",
    "bunraku.launch": "launch",
}
LINKS = ("nodes", "nodes.*", "msgs", "msgs.*", "launch", "launch.*")

packages = set(FOLDERS)
for package, folder in FOLDERS.items():
    exclude = LINKS if package == "bunraku" else ()
    packages |= {f"{package}.{name}" for name in find_packages(folder, exclude=exclude)}

setup(package_dir=FOLDERS, packages=sorted(packages))

"""Licences of every crate that is linked into the program, with their texts as the crates bring them.

    cargo metadata --locked --format-version 1 --filter-platform TRIPLE | python3 src/packaging/third-party.py

Ends with status 1 when a crate names no licence.
"""

import json
import pathlib
import sys


def linked(metadata):
    """Ids of what the root package needs to run: no build or test dependencies."""
    nodes = {node["id"]: node for node in metadata["resolve"]["nodes"]}
    found, waiting = set(), [metadata["resolve"]["root"]]
    while waiting:
        identity = waiting.pop()
        if identity not in found:
            found.add(identity)
            waiting += [dep["pkg"] for dep in nodes[identity]["deps"] if any(kind["kind"] is None for kind in dep["dep_kinds"])]
    return found


def main():
    metadata = json.load(sys.stdin)
    needed, own = linked(metadata), set(metadata["workspace_members"])
    without = []
    for package in sorted(metadata["packages"], key=lambda package: (package["name"], package["version"])):
        if package["id"] not in needed or package["id"] in own:
            continue
        if not (package["license"] or package["license_file"]):
            without.append(package["name"])
        print(f"{'=' * 100}\n{package['name']} {package['version']}: {package['license']}\n{package['repository'] or ''}\n")
        folder = pathlib.Path(package["manifest_path"]).parent
        for path in sorted(folder.iterdir()):
            if path.is_file() and path.name.upper().startswith(("LICEN", "COPYING", "COPYRIGHT", "NOTICE", "UNLICENSE")):
                print(f"--- {path.name}\n\n{path.read_text(errors='replace').strip()}\n")
    if without:
        sys.exit(f"crates without a licence: {', '.join(without)}")


main()

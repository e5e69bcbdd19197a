"""``python -m hystid.modelica.library``: write the shipped flat models again."""

from __future__ import annotations

import json

from hystid.files import write_text
from hystid.modelica.compile import flat_from_text
from hystid.modelica.flat import SCHEMA, to_json
from hystid.modelica.library import FOLDER, digest, library_models


def regenerate() -> list[str]:
    """Write the flat model of every library model, remove those of models that are gone; returns the names."""
    names = library_models()
    for name in names:
        write_text(FOLDER / f"{name}.json", to_json(flat_from_text(name)))
    for path in FOLDER.glob("HystId.*.json"):
        if path.stem not in names:
            path.unlink()
    index = {"schema": SCHEMA, "digests": {name: digest(name) for name in names}}
    write_text(FOLDER / "index.json", json.dumps(index, indent=1) + "\n")
    return names


if __name__ == "__main__":
    print(f"{len(regenerate())} flat models written")

"""Draw the pictures of the manual into docs/img.

python docs/make_pictures.py            # all of them
python docs/make_pictures.py maps path  # some
"""

from __future__ import annotations

import sys

from pictures import answers, drift, learning, readout

PICTURES = {
    "learning": learning.learning,
    "winner": learning.winner,
    "density": learning.density,
    "links": answers.links,
    "maps": answers.maps,
    "path": answers.path,
    "local": readout.local,
    "bounds": readout.bounds,
    "drift": drift.drift,
}


def main(names: list[str]) -> None:
    """Draw the pictures of these names, or all."""
    unknown = [name for name in names if name not in PICTURES]
    if unknown:
        raise SystemExit(f"no pictures {', '.join(unknown)}: choose from {', '.join(PICTURES)}")
    for name in names or PICTURES:
        PICTURES[name]()
        print(f"docs/img/{name}.png")


if __name__ == "__main__":
    main(sys.argv[1:])

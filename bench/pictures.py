#!/usr/bin/env python3
"""pictures.py [--work DIR] [--output DIR]

Makes the pictures of doc/accuracy.md: each mesh simplified by spbm and by a peer to the same count,
drawn side by side. Inputs and peers are those of accuracy.py (scripts/peers.sh builds the drivers).
The figures that it prints are `spbm measure`'s.
"""
import argparse
import json
import os

from accuracy import PEERS, figures, prepare
from record import ROOT, Run

# name: faces, the peer, the view's direction
PICTURES = {
    "bunny": (1504, "CGAL Garland-Heckbert"),
    "dragon": (8700, "CGAL Garland-Heckbert"),
    "brain": (30600, "meshoptimizer"),
    "fandisk": (260, "CGAL Garland-Heckbert"),
}


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[1])
    parser.add_argument("--spbm", default=f"{ROOT}/build/tools/spbm")
    parser.add_argument("--peers", default=f"{ROOT}/build/peers", help="folder of the drivers")
    parser.add_argument("--work", default=f"{ROOT}/build/accuracy")
    parser.add_argument("--output", default=f"{ROOT}/doc", help="where the pictures go")
    options = parser.parse_args()
    os.makedirs(options.work, exist_ok=True)
    for name, (faces, peer) in PICTURES.items():
        mesh, _ = prepare(options.spbm, None, options.work, name)
        folder = f"{options.work}/{name}-{faces}-picture"
        os.makedirs(folder, exist_ok=True)
        own, other = f"{folder}/spbm.ply", f"{folder}/{peer.replace(' ', '-')}.ply"
        Run([options.spbm, "simplify", mesh, "-o", own, "--faces", str(faces), "-q"], (0, 3))
        program, argument = PEERS[peer]
        if not os.path.exists(other):
            Run([f"{options.peers}/{program}", argument, mesh, other, str(faces)])
        for path in (own, other):
            text = Run([options.spbm, "measure", mesh, path, "-q", "--json", "-"],
                       keep_output=True).output
            found = figures({"measurement": json.loads(text)["measurement"]})
            print(name, os.path.basename(path), *(f"{key} {found[key]:.2e}" for key in found))
        Run([options.spbm, "render", own, other, "-o", f"{options.output}/accuracy-{name}.png",
             "--size", "480x400", "-q"])


if __name__ == "__main__":
    main()

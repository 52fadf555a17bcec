#!/bin/sh
# peers.sh: installs the other simplifiers that Debian has and builds their drivers (bench/peers) in
# build/peers, for the benchmarks only: neither the program nor its tests need them.
set -eu
root=$(cd "$(dirname "$0")/.." && pwd)
"$root/scripts/install_missing" g++ libmeshoptimizer-dev libcgal-dev libeigen3-dev libgmp-dev \
    libmpfr-dev libvtk9-dev libopenmesh-dev
out=$root/build/peers
mkdir -p "$out"
cd "$root/bench/peers"
flags='-O3 -DNDEBUG'
g++ $flags meshoptimizer.cpp -o "$out/meshoptimizer" -lmeshoptimizer
g++ $flags -I/usr/include/eigen3 cgal.cpp -o "$out/cgal" -lgmp -lmpfr
g++ $flags -I"$root/src" cgal_distance.cpp -o "$out/cgal_distance" -lgmp -lmpfr
g++ $flags openmesh.cpp -o "$out/openmesh" -lOpenMeshCore -lOpenMeshTools
g++ $flags -Wno-deprecated -I/usr/include/vtk-9.1 vtk.cpp -o "$out/vtk" -lvtkFiltersCore-9.1 \
    -lvtkCommonDataModel-9.1 -lvtkCommonExecutionModel-9.1 -lvtkCommonCore-9.1 -lvtksys-9.1
g++ -O2 -DNDEBUG manifold.cpp -o "$out/manifold" -lgmp -lmpfr

#!/usr/bin/env python3
"""Reads a mesh store, written from src/mesh/store_format.md and src/base/section_file_format.md
alone, with nothing of the program. As a program: read_store.py STORE checks the file and prints what
it holds, one figure a line; with -o OUT.ply it writes the mesh as a binary PLY."""
import math
import struct
import sys
import zlib

NONE = 0xFFFFFFFF
SIZES = [1, 1, 2, 2, 4, 4, 4, 8]
PLY_TYPES = ['char', 'uchar', 'short', 'ushort', 'int', 'uint', 'float', 'double']
TOPOLOGY = ['vertices', 'edges', 'faces', 'border_edges', 'border_loops', 'components', 'euler',
            'floor']
CLEANING = ['input_vertices', 'input_faces', 'triangulated_faces', 'welded_vertices',
            'unreferenced_vertices', 'degenerate_faces', 'duplicate_faces', 'nonmanifold_edges',
            'nonmanifold_vertices', 'vertices_added', 'flipped_faces', 'cut_edges',
            'nonorientable_components', 'zero_area_faces', 'hilbert_ordered']


class Damaged(Exception):
    pass


def need(condition, what):
    if not condition:
        raise Damaged(what)


def aligned(offset):
    return (offset + 63) // 64 * 64


def read_sections(data, magic, version):
    """The frame: {kind: bytes}."""
    need(len(data) >= 96, 'too short')
    need(data[:8] == magic, 'wrong magic')
    need(struct.unpack_from('<I', data, 8)[0] == version, 'wrong version')
    need(not any(data[12:32]), 'header is not zero')
    end = data[-32:]
    need(end[24:] == b'spbm end', 'cut off')
    table_at, count, crc, size = struct.unpack_from('<QIIQ', end, 0)
    need(size == len(data), 'wrong size')
    need(count <= 64 and table_at + 24 * count + 32 == size, 'table out of place')
    frame = data[:32] + data[table_at:-32] + end[:12] + bytes(4) + end[16:]
    need(zlib.crc32(frame) == crc, 'frame damaged')
    need(not any(data[32:64]), 'padding')
    sections, at = {}, 64
    for i in range(count):
        kind, crc, offset, length = struct.unpack_from('<IIQQ', data, table_at + 24 * i)
        kind = struct.pack('<I', kind).decode()
        need(offset == at and offset + length <= table_at, kind + ' out of place')
        need(kind not in sections, kind + ' repeated')
        body = data[offset:offset + length]
        need(zlib.crc32(body) == crc, kind + ' damaged')
        at = aligned(offset + length)
        need(not any(data[offset + length:min(at, table_at)]), 'padding')
        sections[kind] = body
    need(at == table_at, 'table out of place')
    return sections


class Store:
    def __init__(self, path):
        with open(path, 'rb') as file:
            sections = read_sections(file.read(), b'spbmMSH1', 1)
        need(list(sections) == ['SLAB', 'STAB', 'ATTR', 'INFO'], 'wrong sections')
        self.read_info(sections['INFO'])
        self.read_attributes(sections['ATTR'])
        self.faces, self.neighbours, self.mates = [], [], []
        self.positions, self.records = [], []
        self.read_slabs(sections['SLAB'], sections['STAB'])

    def read_info(self, data):
        need(len(data) == 560, 'info has a wrong size')
        self.shift, self.slab_count, self.flags, self.digest = struct.unpack_from('<4I', data, 0)
        need(2 <= self.shift <= 18, 'slab size')
        self.input_size = struct.unpack_from('<Q', data, 16)[0]
        self.topology = dict(zip(TOPOLOGY, struct.unpack_from('<6QqQ', data, 24)))
        self.cleaning = dict(zip(CLEANING, struct.unpack_from('<15Q', data, 88)))
        self.origin = struct.unpack_from('<3d', data, 208)
        self.box = struct.unpack_from('<6d', data, 232)
        self.mean_edge, self.noise, self.area = struct.unpack_from('<3d', data, 280)
        self.name = data[304:].rstrip(b'\0')

    def read_attributes(self, data):
        count, self.stride = struct.unpack_from('<II', data, 0)
        need(count <= 64 and len(data) == 8 + 72 * count, 'attributes')
        self.attributes, offset = [], 0
        for i in range(count):
            at = 8 + 72 * i
            name = data[at:at + 64].rstrip(b'\0').decode()
            kind, where = struct.unpack_from('<II', data, at + 64)
            need(name and kind < 8 and where == offset, 'attribute')
            offset += SIZES[kind]
            self.attributes.append((name, kind))
        need(offset == self.stride, 'stride')

    def read_slabs(self, blocks, table):
        need(len(table) == 32 * self.slab_count, 'slab table')
        left, at, vertices = self.topology['faces'], 0, 0
        for i in range(self.slab_count):
            offset, first, own, foreign, faces, crc, zero = struct.unpack_from('<Q6I', table, 32 * i)
            need(offset == at and first == vertices and zero == 0, 'slab entry')
            need(faces == min(left, 1 << self.shift) and own + foreign <= 3 * faces, 'slab entry')
            pieces, end = [], 0
            for size in [12 * faces, 12 * faces, faces, 12 * own, 4 * foreign, 12 * foreign,
                         self.stride * own]:
                begin = aligned(end)
                need(not any(blocks[at + end:at + begin]), 'padding in a slab')
                end = begin + size
                pieces.append(blocks[at + begin:at + end])
            need(not any(blocks[at + end:at + aligned(end)]), 'padding in a slab')
            end = aligned(end)
            need(zlib.crc32(blocks[at:at + end]) == crc, 'slab damaged')
            self.read_slab(first, own, pieces)
            left, at, vertices = left - faces, at + end, vertices + own
        need(left == 0 and at == len(blocks) and vertices == self.topology['vertices'], 'sums')

    def read_slab(self, first, own, pieces):
        def words(piece, kind, size):
            return list(struct.iter_unpack('<' + kind * size, piece))
        faces, neighbours = words(pieces[0], 'I', 3), words(pieces[1], 'I', 3)
        self.positions += words(pieces[3], 'f', 3)
        foreign = [word[0] for word in words(pieces[4], 'I', 1)]
        copies = words(pieces[5], 'f', 3)
        need(all(a < b for a, b in zip(foreign, foreign[1:])), 'foreign list')
        used = {v for face in faces for v in face}
        need(used == set(range(first, first + own)) | set(foreign), 'vertices of a slab')
        need(not foreign or foreign[-1] < first, 'foreign list')
        need(all(self.positions[v] == copy for v, copy in zip(foreign, copies)), 'foreign position')
        self.faces += faces
        self.neighbours += neighbours
        self.mates += pieces[2]
        if self.stride:
            self.records += [pieces[6][i:i + self.stride]
                             for i in range(0, len(pieces[6]), self.stride)]

    def check_mesh(self):
        """What the page says about the mesh."""
        seen, sides = 0, {}
        for f, face in enumerate(self.faces):
            need(len(set(face)) == 3, 'face repeats a vertex')
            for k in range(3):
                need(face[k] <= seen, 'first use')
                seen += face[k] == seen
                side = (face[k], face[(k + 1) % 3])
                need(side not in sides, 'two faces run alike along an edge')
                sides[side] = (f, k)
        need(seen == self.topology['vertices'], 'unused vertices')
        need(len({tuple(sorted(face)) for face in self.faces}) == len(self.faces), 'duplicates')
        borders = 0
        for (a, b), (f, k) in sides.items():
            over = sides.get((b, a), (NONE, 0))
            need((self.neighbours[f][k], self.mates[f] >> 2 * k & 3) == over, 'neighbour')
            borders += over[0] == NONE
        need(not any(mate >> 6 for mate in self.mates), 'mates')
        edges = (len(sides) + borders) // 2
        need(borders == self.topology['border_edges'], 'border edges')
        need(edges == self.topology['edges'] and
             self.topology['euler'] == seen - edges + len(self.faces), 'Euler characteristic')
        self.check_components(sides)

    def check_components(self, sides):
        parent = list(range(len(self.faces)))

        def root(i):
            while parent[i] != i:
                parent[i] = parent[parent[i]]
                i = parent[i]
            return i
        for f, neighbours in enumerate(self.neighbours):
            for g in neighbours:
                if g != NONE:
                    parent[root(f)] = root(g)
        following = {}
        for (a, b), _ in sides.items():
            if (b, a) not in sides:
                need(a not in following, 'two borders at a vertex')
                following[a] = b
        of_vertex, euler, loops = {}, {}, {}
        for f, face in enumerate(self.faces):
            c = root(f)
            euler[c] = euler.get(c, 0) + 2
            for k in range(3):
                euler[c] -= 2 if self.neighbours[f][k] == NONE else 1
                if face[k] not in of_vertex:
                    euler[c] += 2
                need(of_vertex.setdefault(face[k], c) == c, 'components share a vertex')
        while following:
            start, at = following.popitem()
            while at != start:
                at = following.pop(at)
            loops[of_vertex[start]] = loops.get(of_vertex[start], 0) + 1
        need(len(euler) == self.topology['components'], 'components')
        need(sum(loops.values()) == self.topology['border_loops'], 'border loops')
        total = sum(floor(twice // 2, loops.get(c, 0)) for c, twice in euler.items())
        need(total == self.topology['floor'], 'floor')

    def position(self, v):
        return tuple(o + p for o, p in zip(self.origin, self.positions[v]))

    def mean_edge_and_area(self):
        length, count, area = 0.0, 0, 0.0
        for f, face in enumerate(self.faces):
            p = [self.positions[v] for v in face]
            along = [[q - r for q, r in zip(p[(k + 1) % 3], p[k])] for k in range(3)]
            (ax, ay, az), (bx, by, bz) = along[0], along[1]
            cross = (ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx)
            area += math.sqrt(sum(c * c for c in cross)) / 2
            for k in range(3):
                if self.neighbours[f][k] > f:
                    length += math.sqrt(sum(c * c for c in along[k]))
                    count += 1
        return length / count, area


def floor(euler, loops):
    if loops:
        return max(3 * loops - 2 * euler, 1)
    genus = (2 - euler) // 2
    n = 3
    while (n - 3) * (n - 4) < 12 * genus or n < 4:
        n += 1
    return 2 * ((10 if genus == 2 else n) - euler)


def write_ply(store, path):
    """Positions as float if the store says that all are, else as double."""
    kind, code = ('float', 'f') if store.flags & 1 else ('double', 'd')
    with open(path, 'wb') as out:
        lines = ['ply', 'format binary_little_endian 1.0',
                 'element vertex %d' % len(store.positions)]
        lines += ['property %s %s' % (kind, axis) for axis in 'xyz']
        lines += ['property %s %s' % (PLY_TYPES[t], name) for name, t in store.attributes]
        lines += ['element face %d' % len(store.faces),
                  'property list uchar int vertex_indices', 'end_header', '']
        out.write('\n'.join(lines).encode())
        for v in range(len(store.positions)):
            out.write(struct.pack('<3' + code, *store.position(v)))
            if store.stride:
                out.write(store.records[v])
        for face in store.faces:
            out.write(struct.pack('<B3I', 3, *face))


def main(arguments):
    try:
        store = Store(arguments[0])
        store.check_mesh()
    except Damaged as what:
        print('%s: damaged: %s' % (arguments[0], what), file=sys.stderr)
        return 1
    for key, value in list(store.topology.items()) + list(store.cleaning.items()):
        print(key, value)
    if arguments[1:2] == ['-o']:
        write_ply(store, arguments[2])
    return 0


if __name__ == '__main__':
    sys.exit(main(sys.argv[1:]))

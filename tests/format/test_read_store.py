"""The mesh store as read_store.py reads it, which is written from the format pages alone, against the
program's own words: the same counts, measures and provenance as `spbm info`, the same vertices, faces
and attributes as `spbm export`, and any damage found by both."""
import json
import math
import os
import struct
import subprocess
import sys
import tempfile
import unittest
import zlib

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
import read_store  # noqa: E402

PROGRAM = os.environ['SPBM_PROGRAM']
DATA = os.environ.get('SPBM_DATA', '../shared/data')


def torus(around, across):
    vertices, faces = [], []
    for i in range(around):
        for j in range(across):
            a, b = 2 * math.pi * i / around, 2 * math.pi * j / across
            ring = 3 + math.cos(b)
            vertices.append((ring * math.cos(a), ring * math.sin(a), math.sin(b)))
            here, right = i * across + j, (i + 1) % around * across + j
            up, both = i * across + (j + 1) % across, (i + 1) % around * across + (j + 1) % across
            faces += [(here, right, both), (here, both, up)]
    return vertices, faces


def ply(vertices, faces, kind='float', extra=False):
    """Binary; with `extra` each vertex has a uchar and a short besides."""
    code = {'float': 'f', 'double': 'd'}[kind]
    lines = ['ply', 'format binary_little_endian 1.0', 'element vertex %d' % len(vertices)]
    lines += ['property %s %s' % (kind, axis) for axis in 'xyz']
    lines += ['property uchar red', 'property short tag'] if extra else []
    lines += ['element face %d' % len(faces), 'property list uchar int vertex_indices',
              'end_header', '']
    out = ['\n'.join(lines).encode()]
    for i, vertex in enumerate(vertices):
        out.append(struct.pack('<3' + code, *vertex))
        if extra:
            out.append(struct.pack('<Bh', i % 256, i - 300))
    out += [struct.pack('<B3i', 3, *face) for face in faces]
    return b''.join(out)


def body(path):
    """What follows a PLY's header."""
    with open(path, 'rb') as file:
        data = file.read()
    return data[data.index(b'end_header\n') + 11:]


class StoreFormat(unittest.TestCase):
    def setUp(self):
        self.folder = tempfile.TemporaryDirectory()

    def tearDown(self):
        self.folder.cleanup()

    def path(self, name):
        return os.path.join(self.folder.name, name)

    def run_program(self, *arguments, expect=0):
        done = subprocess.run([PROGRAM, *arguments], capture_output=True, check=False)
        self.assertEqual(done.returncode, expect, done.stderr.decode())
        return done

    def compare(self, *inputs, options=()):
        """Imports and looks at the store both ways; returns it as the reader has it."""
        store_path, ours, theirs = self.path('a.store'), self.path('a.ply'), self.path('b.ply')
        self.run_program('import', *inputs, '-o', store_path, *options)
        store = read_store.Store(store_path)
        store.check_mesh()
        said = json.loads(self.run_program('info', store_path, '--json', '-').stdout)['store']
        self.assertEqual(said['topology'], store.topology)
        self.assertEqual(said['cleaning'], store.cleaning)
        self.assertEqual(said['box_low'] + said['box_high'], list(store.box))
        self.assertEqual(said['origin'], list(store.origin))
        self.assertEqual(said['is_float32'], bool(store.flags & 1))
        self.assertEqual(said['welded'], bool(store.flags & 2))
        self.assertEqual((said['mean_edge'], said['noise'], said['area']),
                         (store.mean_edge, store.noise, store.area))
        self.assertEqual(said['slabs'], store.slab_count)
        self.assertEqual(said['input_name'].encode(), store.name)
        self.assertEqual(said['input_crc32'], store.digest)
        self.assertEqual(said['input_size'], store.input_size)
        mean, area = store.mean_edge_and_area()
        self.assertAlmostEqual(mean / store.mean_edge, 1, 12)
        self.assertAlmostEqual(area / store.area, 1, 12)
        self.run_program('export', store_path, '-o', theirs)
        read_store.write_ply(store, ours)
        self.assertEqual(body(ours), body(theirs))
        return store

    def write(self, name, data):
        with open(self.path(name), 'wb') as file:
            file.write(data)
        return self.path(name)

    def test_plain(self):
        data = ply(*torus(30, 20))
        store = self.compare(self.write('torus.ply', data))
        self.assertEqual(store.topology['floor'], 14)
        self.assertEqual(store.digest, zlib.crc32(data))
        self.assertEqual(store.input_size, len(data))
        self.assertEqual(store.name, b'torus.ply')

    def test_several_slabs(self):
        vertices, faces = torus(500, 270)
        store = self.compare(self.write('large.ply', ply(vertices, faces)))
        self.assertEqual(store.slab_count, 5)  # 2^16 faces each
        self.assertEqual(store.shift, 16)
        self.assertEqual(store.cleaning['hilbert_ordered'], 0)
        known = {struct.unpack('<3f', struct.pack('<3f', *v)) for v in vertices}
        self.assertTrue(all(position in known for position in store.positions))

    def test_doubles(self):
        vertices, faces = torus(20, 12)
        moved = [(x + 691234.5678, y + 5334567.8912, z + 0.1) for x, y, z in vertices]
        store = self.compare(self.write('far.ply', ply(moved, faces, 'double')))
        extent = max(store.box[i + 3] - store.box[i] for i in range(3))
        close = sorted(moved)
        for ours, theirs in zip(sorted(store.position(v) for v in range(len(moved))), close):
            for a, b in zip(ours, theirs):
                self.assertLessEqual(abs(a - b), extent / 2 ** 24)

    def test_attributes_and_several_inputs(self):
        mesh = torus(11, 9)
        first = self.write('1.ply', ply(*mesh, extra=True))
        second = self.write('2.ply', ply([(x, y, z + 9) for x, y, z in mesh[0]], mesh[1], extra=True))
        store = self.compare(first, second)
        self.assertEqual(store.attributes, [('red', 1), ('tag', 2)])
        self.assertEqual(sorted(struct.unpack('<Bh', r) for r in store.records),
                         sorted(2 * [(i % 256, i - 300) for i in range(99)]))
        digest = 0
        for i, name in enumerate(['1.ply', '2.ply']):
            with open(self.path(name), 'rb') as file:
                crc = zlib.crc32(file.read())
            digest = zlib.crc32(struct.pack('<I', crc), digest) if i else crc
        self.assertEqual(store.digest, digest)

    def test_cut_and_separated(self):
        """A Moebius strip and two tetrahedra that share an edge."""
        text = ['OFF', '%d %d 0' % (24 + 6, 24 + 8)]
        for i in range(12):
            a = 2 * math.pi * i / 12
            for side in (-1, 1):
                r = 3 + side * math.cos(a / 2)
                text.append('%r %r %r' % (r * math.cos(a), r * math.sin(a), side * math.sin(a / 2)))
        text += ['0 0 9', '0 0 8', '1 0 8', '0 1 8', '-1 0 8', '0 -1 8']
        for i in range(12):
            a, b = 2 * i, 2 * i + 1
            c, d = (2 * i + 2, 2 * i + 3) if i < 11 else (1, 0)
            text += ['3 %d %d %d' % (a, c, d), '3 %d %d %d' % (a, d, b)]
        for p, q in ((26, 27), (28, 29)):
            for f in ((24, 25, p), (24, p, q), (24, q, 25), (25, q, p)):
                text.append('3 %d %d %d' % f)
        store = self.compare(self.write('a.off', '\n'.join(text + ['']).encode()))
        self.assertEqual(store.cleaning['nonorientable_components'], 1)
        self.assertEqual(store.cleaning['nonmanifold_edges'], 1)
        self.assertEqual(store.topology['components'], 3)

    def test_weld(self):
        vertices, faces = torus(12, 7)
        soup = [vertices[v] for face in faces for v in face]
        data = ply(soup, [(i, i + 1, i + 2) for i in range(0, len(soup), 3)])
        store = self.compare(self.write('soup.ply', data), options=['--weld'])
        self.assertEqual(store.topology['vertices'], len(vertices))
        self.assertEqual(store.cleaning['welded_vertices'], len(soup) - len(vertices))

    @unittest.skipUnless(os.path.isdir(DATA), 'no ' + DATA)
    def test_real_files(self):
        for name in ['cube_poly.off', 'double-torus-example.off', 'femur.off', 'mushroom.off',
                     'blobby-shuffled.off', 'cad_m3_hex_nut.stl', 'cad_box.stl',
                     'photogrammetry_birdbath_holes.ply', 'cad_cycloidal_coloured_nonmanifold.ply']:
            with self.subTest(name):
                self.compare(os.path.join(DATA, name))

    def test_damage_is_found_by_both(self):
        self.run_program('import', self.write('a.ply', ply(*torus(4, 3), extra=True)), '-o',
                         self.path('a.store'))
        with open(self.path('a.store'), 'rb') as file:
            data = bytearray(file.read())
        for i in range(0, len(data), 7):
            data[i] ^= 1 << i % 8
            path = self.write('bad.store', data)
            with self.assertRaises(read_store.Damaged):
                read_store.Store(path).check_mesh()
            if i % 16 == 0:
                self.run_program('check', path, expect=1)
            data[i] ^= 1 << i % 8


if __name__ == '__main__':
    unittest.main()

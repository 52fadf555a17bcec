#!/usr/bin/env python3
"""Reads a chain file from src/simplify/chain_format.md and src/base/section_file_format.md alone (Python's
standard library only) and prints a summary. It checks what the pages say; the first thing that is
wrong ends it with exit code 1. With --all it prints every block in full.

    read_chains.py FILE [--all]
"""
import math
import struct
import sys
import zlib


class Damaged(Exception):
    pass


def must(condition, what):
    if not condition:
        raise Damaged(what)


# ---- section_file_format.md ----

def read_sections(data, magic, version):
    must(len(data) >= 96, 'too short')
    must(data[:8] == magic, 'wrong magic')
    must(struct.unpack_from('<I', data, 8)[0] == version, 'wrong version')
    must(not any(data[12:64]), 'header is not zero where it should be')
    marker = data[-32:]
    must(marker[24:] == b'spbm end', 'no end marker')
    table_at, count, frame_crc, size = struct.unpack_from('<QIIQ', marker)
    must(size == len(data) and count <= 64, 'size')
    must(table_at + 24 * count + 32 == size, 'table')
    table = data[table_at:table_at + 24 * count]
    crc = zlib.crc32(data[:32])
    crc = zlib.crc32(table, crc)
    crc = zlib.crc32(marker[:12] + bytes(4) + marker[16:], crc)
    must(crc == frame_crc, 'CRC of the frame')
    sections, at = {}, 64
    order = []
    for i in range(count):
        kind, crc, offset, length = struct.unpack_from('<IIQQ', table, 24 * i)
        name = struct.pack('<I', kind).decode('ascii')
        must(offset == (at + 63) // 64 * 64, 'place of section ' + name)
        must(not any(data[at:offset]), 'padding')
        at = offset + length
        must(at <= table_at and name not in sections, 'section ' + name)
        sections[name] = data[offset:at]
        order.append(name)
        must(zlib.crc32(sections[name]) == crc, 'CRC of section ' + name)
    must(table_at == (at + 63) // 64 * 64 and not any(data[at:table_at]), 'end of the sections')
    return sections, order


def unpack_block(block):
    must(len(block) >= 24 and block[:4] == b'blk1', 'block header')
    stored, raw, raw_crc, stored_crc, header_crc = struct.unpack_from('<5I', block, 4)
    must(zlib.crc32(block[:20]) == header_crc, 'CRC of a block header')
    must(len(block) == 24 + stored and stored <= raw <= 1 << 30, 'size of a block')
    body = block[24:]
    must(zlib.crc32(body) == stored_crc, 'CRC of stored bytes')
    if stored != raw:
        inflater = zlib.decompressobj(-15)
        body = inflater.decompress(body)
        must(inflater.eof and not inflater.unused_data and len(body) == raw, 'DEFLATE stream')
    must(zlib.crc32(body) == raw_crc, 'CRC of raw bytes')
    return body


# ---- chain_format.md ----

TYPE_SIZES = (1, 1, 2, 2, 4, 4, 4, 8)
MASK = 0xffffffff


def read_info(data):
    names32 = ('slabs', 'is_float32', 'store_crc', 'mode', 'effort', 'target_kind', 'target_count',
               'smoothings', 'most_patch_faces', 'attribute_count')
    info = dict(zip(names32, struct.unpack_from('<10I', data, 0)))
    info['topology'] = struct.unpack_from('<6QqQ', data, 40)
    info['origin'] = struct.unpack_from('<3d', data, 104)
    info['box'] = struct.unpack_from('<6d', data, 128)
    info['mean_edge'], info['noise'], info['area'] = struct.unpack_from('<3d', data, 176)
    info['cosines'] = struct.unpack_from('<4d', data, 200)
    info['tolerances'] = struct.unpack_from('<2d', data, 232)
    info['targets'] = struct.unpack_from('<16d', data, 248)
    names64 = ('patches', 'chains', 'seam_chains', 'junctions', 'chain_vertices', 'most_faces')
    info.update(zip(names64, struct.unpack_from('<6Q', data, 376)))
    must(len(data) == 424 + 72 * info['attribute_count'], 'size of INFO')
    info['attributes'], offset = [], 0
    for i in range(info['attribute_count']):
        name, kind, at = struct.unpack_from('<64sII', data, 424 + 72 * i)
        must(at == offset and kind < 8 and name[63] == 0, 'attribute')
        offset += TYPE_SIZES[kind]
        info['attributes'].append((name.rstrip(b'\0').decode(), kind, at))
    info['stride'] = offset
    return info


class Source:
    def __init__(self, data):
        self.data, self.at = data, 0

    def varint(self):
        value, shift = 0, 0
        while True:
            byte = self.data[self.at]
            self.at += 1
            value |= (byte & 127) << shift
            if byte < 128:
                must(value <= MASK and shift < 35, 'varint')
                return value
            shift += 7

    def take(self, size):
        must(self.at + size <= len(self.data), 'columns are cut off')
        self.at += size
        return self.data[self.at - size:self.at]


def unzigzag(code):
    return -(code + 1) // 2 if code & 1 else code // 2


def planes(data, count):
    return [bytes(data[b * count + i] for b in range(len(data) // count)) for i in range(count)]


def float32(value):
    return struct.unpack('<f', struct.pack('<f', value))[0]


def unit_vector(code):
    a, b = struct.unpack('<hh', code)
    must(a != -32768 and b != -32768, 'normal')
    must((abs(a) < 32767 or b >= 0) and (abs(b) < 32767 or a >= 0), 'normal')
    u, v = a / 32767, b / 32767
    x, y, z = u, v, 1 - abs(u) - abs(v)
    if z < 0:
        x = (1 - abs(v)) * (-1 if u < 0 else 1)
        y = (1 - abs(u)) * (-1 if v < 0 else 1)
    length = math.sqrt(x * x + y * y + z * z)
    return tuple(float32(c / length + 0.0) for c in (x, y, z))


class Block:
    pass


def read_block(raw, slab, stride):
    block, source = Block(), Source(raw)
    block.slab = slab
    junctions, seams, chain_total, patch_total, chain_count, patch_count, diagonal_count = (
        source.varint() for _ in range(7))
    block.junctions, block.seams = junctions, seams
    vertex_count = junctions + seams + chain_total + patch_total

    block.seam_vertices, at = [], -1
    for _ in range(seams):
        at += source.varint() + 1
        block.seam_vertices.append(at)

    lefts, left = [], 0
    for _ in range(chain_count):
        left += source.varint()
        lefts.append(left)
    rights = []
    for left in lefts:
        difference = source.varint()
        must(difference <= left, 'right patch')
        rights.append(left - difference if difference else None)
    counts = [source.varint() for _ in range(chain_count)]
    must(sum(counts) == chain_total, 'interiors of the chains')
    named, seam, first = 0, 0, junctions + seams
    block.chains = []
    for i in range(chain_count):
        ends = []
        for _ in range(2):
            code = source.varint()
            if code == 0:
                ends.append(named)
                named += 1
            elif code & 1:
                ends.append(named - 1 - code // 2)
            else:
                seam += unzigzag((code - 2) // 2)
                must(0 <= seam < seams, 'seam vertex')
                ends.append(junctions + seam)
        must(0 <= min(ends) and ends[0] != ends[1], 'ends of a chain')
        interior = list(range(first, first + counts[i]))
        first += counts[i]
        must(lefts[i] < patch_count, 'left patch')
        block.chains.append((lefts[i], rights[i], [ends[0]] + interior + [ends[1]]))
    must(named == junctions, 'junctions')

    interior_counts = [source.varint() for _ in range(patch_count)]
    must(sum(interior_counts) == patch_total, 'interiors of the patches')
    diagonal_counts = [0 if n else source.varint() for n in interior_counts]
    must(sum(diagonal_counts) == diagonal_count, 'diagonals of the patches')
    normals = [unit_vector(code) for code in planes(source.take(4 * patch_count), patch_count)]
    areas = [struct.unpack('<f', v)[0] for v in planes(source.take(4 * patch_count), patch_count)]
    deviations = [struct.unpack('<f', v)[0]
                  for v in planes(source.take(4 * patch_count), patch_count)]
    at, diagonals = 0, []
    for _ in range(2 * diagonal_count):
        at = (at + unzigzag(source.varint())) & MASK
        must(at < vertex_count, 'diagonal')
        diagonals.append(at)
    block.patches, next_diagonal = [], 0
    first = junctions + seams + chain_total
    for p in range(patch_count):
        own = diagonals[2 * next_diagonal:2 * (next_diagonal + diagonal_counts[p])]
        next_diagonal += diagonal_counts[p]
        block.patches.append((normals[p], areas[p], deviations[p],
                              list(range(first, first + interior_counts[p])),
                              list(zip(own[0::2], own[1::2]))))
        first += interior_counts[p]

    read_vertices(block, source, vertex_count, stride)
    must(source.at == len(raw), 'bytes are left over')
    return block


def vertex_order(block):
    """Pairs (vertex, base) in the order of the planes."""
    base, met = None, 0
    for v in range(block.junctions, block.junctions + block.seams):
        yield v, base
        base = v
    for _, _, vertices in block.chains:
        if vertices[0] == met and met < block.junctions:
            yield vertices[0], base
            met += 1
        for before, v in zip(vertices, vertices[1:-1]):
            yield v, before
        if vertices[-1] == met and met < block.junctions:
            yield vertices[-1], vertices[-2]
            met += 1
        base = vertices[-1]
    first, last = 0, base
    for p, patch in enumerate(block.patches):
        while first + 1 < len(block.chains) and block.chains[first][0] < p:
            first += 1
        base = block.chains[first][2][0] if block.chains else last
        for v in patch[3]:
            yield v, base
            base = v


def read_vertices(block, source, count, stride):
    data = source.take((12 + stride) * count)
    block.ordered = [None] * count
    block.records = [None] * count
    for place, (vertex, base) in enumerate(vertex_order(block)):
        ordered = []
        for axis in range(3):
            code = sum(data[(4 * axis + b) * count + place] << 8 * b for b in range(4))
            expected = 1 << 31 if base is None else block.ordered[base][axis]
            ordered.append((expected + unzigzag(code)) & MASK)
        block.ordered[vertex] = ordered
        like = bytes(stride) if base is None else block.records[base]
        block.records[vertex] = bytes((data[(12 + i) * count + place] + like[i]) & 255
                                      for i in range(stride))
    must(None not in block.ordered, 'a vertex without coordinates')
    block.positions = []
    for ordered in block.ordered:
        bits = [o & 0x7fffffff if o & 0x80000000 else o ^ MASK for o in ordered]
        position = struct.unpack('<3f', struct.pack('<3I', *bits))
        must(all(math.isfinite(c) for c in position), 'coordinate')
        block.positions.append(position)


def read_seams(raw, block, slabs):
    source = Source(raw)
    chain_count, total = source.varint(), source.varint()
    heads, left, other = [], 0, block.slab
    for _ in range(chain_count):
        left += source.varint()
        other += unzigzag(source.varint())
        must(0 <= other < slabs and other != block.slab, 'other slab')
        heads.append((left, other, source.varint(), source.varint() + 2))
    block.seam_chains, at = [], 0
    for left, other, right, count in heads:
        vertices = []
        for _ in range(count):
            at = (at + unzigzag(source.varint())) & MASK
            must(block.junctions <= at < block.junctions + block.seams, 'vertex of a seam chain')
            vertices.append(at)
        block.seam_chains.append((left, other, right, vertices))
    must(sum(head[3] for head in heads) == total and source.at == len(raw), 'seam chains')


def check_loops(block):
    """P1 and P2; returns the sum of loop vertices - 2."""
    following = [{} for _ in block.patches]
    uses = [(left, vertices) for left, _, vertices in block.chains]
    uses += [(right, vertices[::-1]) for _, right, vertices in block.chains if right is not None]
    uses += [(left, vertices) for left, _, _, vertices in block.seam_chains]
    for patch, vertices in uses:
        for a, b in zip(vertices, vertices[1:]):
            must(a not in following[patch], 'a boundary passes a vertex twice')
            following[patch][a] = b
    faces = 0
    for edges, patch in zip(following, block.patches):
        must(len(edges) >= 3, 'a loop of fewer than three edges')
        first = next(iter(edges))
        at, steps = edges[first], 1
        while at != first:
            must(at in edges and steps < len(edges), 'a loop does not close')
            at, steps = edges[at], steps + 1
        must(steps == len(edges), 'more than one loop')
        must(len(patch[4]) == (0 if patch[3] else len(edges) - 3), 'number of diagonals')
        faces += len(edges) - 2
    return faces


def read_trunk(raw, stride, euler):
    must(len(raw) >= 120, 'a trunk is too short')
    place, effort, finest, small_faces, lost, vertex_count, face_count, room = struct.unpack_from(
        '<IIQQdQQQ', raw)
    numbers = struct.unpack_from('<5d2Q2I', raw, 56)
    scale, unit, typical, astray, error_sum, _, _, guard, flat = numbers
    must(place <= 1 and 1 <= effort <= 3 and finest >= 1 and guard <= 2 and flat <= 1, 'a trunk')
    must(math.frexp(scale)[0] == 0.5 and math.frexp(unit)[0] == 0.5, 'scale of a trunk')
    must(all(0 <= x < math.inf for x in (lost, typical, astray, error_sum)), 'errors of a trunk')
    must(face_count <= room < 1 << 32, 'counts of a trunk')
    source = Source(raw)
    source.take(120)
    columns = planes(source.take((20 + stride) * vertex_count), vertex_count)
    positions, records = [], []
    ordered, record = [0x80000000] * 3, bytes(stride)
    for column in columns:
        ordered = [(last + unzigzag(code)) & MASK
                   for last, code in zip(ordered, struct.unpack('<3I', column[:12]))]
        bits = [o ^ (0x80000000 if o >> 31 else MASK) for o in ordered]
        positions.append(struct.unpack('<3f', struct.pack('<3I', *bits)))
        must(all(math.isfinite(c / scale) for c in positions[-1]), 'coordinates of a trunk')
        record = bytes((a + b) & 255 for a, b in zip(record, column[20:]))
        records.append(record)
    first, edges, used = 0, set(), set()
    for _ in range(face_count):
        a = (first + unzigzag(source.varint())) & MASK
        b = (a + unzigzag(source.varint())) & MASK
        c = (b + unzigzag(source.varint())) & MASK
        first = a
        must(max(a, b, c) < vertex_count and len({a, b, c}) == 3, 'a face of a trunk')
        for edge in ((a, b), (b, c), (c, a)):
            must(edge not in edges, 'an edge of a trunk')
            edges.add(edge)
        used.update((a, b, c))
    must(source.at == len(raw), 'end of a trunk')
    edge_count = len({(min(e), max(e)) for e in edges})
    must(len(used) - edge_count + face_count == euler, 'topology of a trunk')
    total = 0.0
    for position in positions:
        for coordinate in position:
            total += coordinate
    return '%d %d %d %d %d %.17g' % (effort, finest, vertex_count, face_count,
                                     sum(map(sum, records)), total)


def summarise(path, show_all):
    with open(path, 'rb') as file:
        data = file.read()
    sections, order = read_sections(data, b'spbmCHN1', 3)
    must(order[:4] == ['BLKS', 'SEAM', 'INDX', 'INFO'] and
         order[4:] in ([], ['TRNK'], ['LOWR'], ['TRNK', 'LOWR']), 'sections')
    info = read_info(sections['INFO'])
    must(len(sections['INDX']) == 8 * info['slabs'], 'size of INDX')
    block_at = seam_at = 0
    chains = seam_chains = patches = most_faces = 0
    sums, area, diagonals, record_sum = [0.0] * 3, 0.0, 0, 0
    junctions, seam_junctions, seam_vertices, chain_vertices = 0, set(), set(), 0
    copies = {}
    for slab in range(info['slabs']):
        block_size, seam_size = struct.unpack_from('<II', sections['INDX'], 8 * slab)
        raw = unpack_block(sections['BLKS'][block_at:block_at + block_size])
        block = read_block(raw, slab, info['stride'])
        read_seams(unpack_block(sections['SEAM'][seam_at:seam_at + seam_size]), block,
                   info['slabs'])
        block_at += block_size
        seam_at += seam_size
        most_faces += check_loops(block)
        chains += len(block.chains)
        patches += len(block.patches)
        junctions += block.junctions
        chain_vertices += block.junctions + sum(len(c[2]) - 2 for c in block.chains)
        seam_vertices.update(block.seam_vertices)
        for left, other, right, vertices in block.seam_chains:
            numbers = [block.seam_vertices[v - block.junctions] for v in vertices]
            seam_junctions.update((numbers[0], numbers[-1]))
            points = [block.positions[v] for v in vertices]
            if slab < other:
                key = (slab, left, other, right, tuple(numbers), tuple(points))
            else:
                key = (other, right, slab, left, tuple(numbers[::-1]), tuple(points[::-1]))
            copies[key] = copies.get(key, 0) + 1
        for position in block.positions:
            sums = [s + c for s, c in zip(sums, position)]
        for record in block.records:
            record_sum += sum(record)
        for normal, patch_area, deviation, _, own in block.patches:
            area += patch_area
            diagonals += len(own)
        if show_all:
            print(vars(block))
    must(block_at == len(sections['BLKS']) and seam_at == len(sections['SEAM']), 'INDX')
    must(all(count == 2 for count in copies.values()), 'copies of a seam chain')
    must(patches == info['patches'] and most_faces == info['most_faces'], 'counts')
    must(chains + len(copies) == info['chains'] and len(copies) == info['seam_chains'], 'counts')
    must(junctions + len(seam_junctions) == info['junctions'], 'counts')
    must(chain_vertices + len(seam_vertices) == info['chain_vertices'], 'counts')
    for name in ('slabs', 'patches', 'chains', 'seam_chains', 'junctions', 'chain_vertices',
                 'most_faces'):
        print(name, info[name])
    print('diagonals', diagonals)
    print('attributes', ' '.join(name for name, _, _ in info['attributes']) or '-')
    print('record_sum', record_sum)
    print('x %.17g' % sums[0])
    print('y %.17g' % sums[1])
    print('z %.17g' % sums[2])
    print('area %.17g' % area)
    for name, kind in (('trunk', 'TRNK'), ('lower', 'LOWR')):
        if kind in sections:
            print(name, read_trunk(unpack_block(sections[kind]), info['stride'],
                                   info['topology'][6]))


def main():
    try:
        summarise(sys.argv[1], '--all' in sys.argv[2:])
    except (Damaged, IndexError, struct.error, zlib.error, ValueError) as error:
        print('%s: %s: %s' % (sys.argv[1], type(error).__name__, error), file=sys.stderr)
        return 1
    return 0


if __name__ == '__main__':
    sys.exit(main())

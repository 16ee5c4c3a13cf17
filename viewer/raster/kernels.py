"""The loops of the renderer, compiled; `kernels_numpy` has plain twins.

Triangles are drawn in homogeneous coordinates (Olano and Greer 1997, "Triangle scan conversion using 2D
homogeneous coordinates"), so that those which reach behind the camera need not be cut: with the projected
corners (x_i w_i, y_i w_i, w_i) as rows of M, the columns of M^-1 are three functions e_i of the place in the
picture, linear in it: the share of corner i over w. Inside all are positive, and their sum is 1 / w.

A sample is a quarter of a pixel, two to a side. Each keeps which triangle it sees; a pixel is shaded once for
each triangle that it sees.
"""

from __future__ import annotations

import math

import numba
import numpy as np

LEAST = 1e-12  # twice the area, in samples, below which a triangle is none
NONE = -1


@numba.njit(cache=True, nogil=True, error_model="numpy")
def place(transforms, parts, vertices, normals, out_vertices, out_normals):
    """Vertices and normals [V, 3] in the world, by the transforms [K, 3, 4] of their parts [V]."""
    for v in range(vertices.shape[0]):
        k = parts[v]
        for i in range(3):
            x, y, z, w = transforms[k, i, 0], transforms[k, i, 1], transforms[k, i, 2], transforms[k, i, 3]
            out_vertices[v, i] = x * vertices[v, 0] + y * vertices[v, 1] + z * vertices[v, 2] + w
            out_normals[v, i] = x * normals[v, 0] + y * normals[v, 1] + z * normals[v, 2]


@numba.njit(cache=True, nogil=True, error_model="numpy")
def project(matrix, vertices, out):
    """Homogeneous places [V, 3] of vertices by a projection [3, 4]."""
    for v in range(vertices.shape[0]):
        for i in range(3):
            out[v, i] = (
                matrix[i, 0] * vertices[v, 0]
                + matrix[i, 1] * vertices[v, 1]
                + matrix[i, 2] * vertices[v, 2]
                + matrix[i, 3]
            )


@numba.njit(cache=True, nogil=True, error_model="numpy")
def visibility(places, triangles, two_sided, near, floor, depth, ids, low, high, shares):
    """Which triangle is seen in each sample.

    places [V, 3] homogeneous, in samples; triangles [F, 3]; two_sided bool [F]; floor [rows] is 1 / w of the
    ground in each row of samples, which hides what is behind it. Changed: depth [rows, columns], the greatest
    1 / w; ids, its triangle; low, high [rows], the columns that were changed; shares [F, 3, 3], the e_i by
    their factors of x, y and 1.
    """
    rows, columns = depth.shape
    p, e = np.empty((3, 3)), np.empty((3, 3))
    for f in range(triangles.shape[0]):
        for i in range(3):
            for k in range(3):
                p[i, k] = places[triangles[f, i], k]
        for i in range(3):
            j, k = (i + 1) % 3, (i + 2) % 3
            e[i, 0] = p[j, 1] * p[k, 2] - p[k, 1] * p[j, 2]
            e[i, 1] = p[k, 0] * p[j, 2] - p[j, 0] * p[k, 2]
            e[i, 2] = p[j, 0] * p[k, 1] - p[k, 0] * p[j, 1]
        size = p[0, 0] * e[0, 0] + p[0, 1] * e[0, 1] + p[0, 2] * e[0, 2]
        # Counter-clockwise from outside is clockwise where y goes down.
        if not abs(size) > LEAST or (size > 0 and not two_sided[f]):
            continue
        sign = 1.0 if size > 0 else -1.0
        left, right, top, bottom = 1e30, -1e30, 1e30, -1e30
        for i in range(3):
            j = (i + 1) % 3
            if p[i, 2] >= near:
                x, y = p[i, 0] / p[i, 2], p[i, 1] / p[i, 2]
                left, right, top, bottom = min(left, x), max(right, x), min(top, y), max(bottom, y)
            if (p[i, 2] >= near) != (p[j, 2] >= near):
                t = (near - p[i, 2]) / (p[j, 2] - p[i, 2])
                x = (p[i, 0] + t * (p[j, 0] - p[i, 0])) / near
                y = (p[i, 1] + t * (p[j, 1] - p[i, 1])) / near
                left, right, top, bottom = min(left, x), max(right, x), min(top, y), max(bottom, y)
        first = math.ceil(max(top - 0.5, 0.0))
        last = math.floor(min(bottom - 0.5, rows - 1.0))
        least, most = max(left - 0.5, 0.0), min(right - 0.5, columns - 1.0)
        if first > last or math.ceil(least) > math.floor(most):
            continue
        zx = (e[0, 0] + e[1, 0] + e[2, 0]) / size
        zy = (e[0, 1] + e[1, 1] + e[2, 1]) / size
        z1 = (e[0, 2] + e[1, 2] + e[2, 2]) / size
        for y in range(first, last + 1):
            start, stop = least, most
            for i in range(3):
                slope, value = sign * e[i, 0], sign * (e[i, 1] * (y + 0.5) + e[i, 2])
                if slope > 0:
                    start = max(start, -value / slope - 0.5)
                elif slope < 0:
                    stop = min(stop, -value / slope - 0.5)
                elif value < 0:
                    stop = -1.0
            if start > stop:
                continue
            x0, x1 = math.ceil(start), math.floor(stop)
            if x0 > x1:
                continue
            low[y], high[y] = min(low[y], x0), max(high[y], x1 + 1)
            ground = floor[y]
            z = zy * (y + 0.5) + z1
            for x in range(x0, x1 + 1):
                near_by = np.float32(z + zx * (x + 0.5))
                if near_by > depth[y, x] and near_by > ground:
                    depth[y, x] = near_by
                    ids[y, x] = f
        for i in range(3):
            for k in range(3):
                shares[f, i, k] = e[i, k] / size


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _from_behind(f, triangles, vertices, eye):
    """Whether the eye sees the back of a triangle."""
    a, b, c = triangles[f, 0], triangles[f, 1], triangles[f, 2]
    ux, uy, uz = (
        vertices[b, 0] - vertices[a, 0],
        vertices[b, 1] - vertices[a, 1],
        vertices[b, 2] - vertices[a, 2],
    )
    vx, vy, vz = (
        vertices[c, 0] - vertices[a, 0],
        vertices[c, 1] - vertices[a, 1],
        vertices[c, 2] - vertices[a, 2],
    )
    ex, ey, ez = eye[0] - vertices[a, 0], eye[1] - vertices[a, 1], eye[2] - vertices[a, 2]
    return (uy * vz - uz * vy) * ex + (uz * vx - ux * vz) * ey + (ux * vy - uy * vx) * ez < 0


@numba.njit(inline="always", cache=True)
def _between(shadow, u, w):
    """The shadow [rows, columns] at column u and row w, between its cells; none beyond its edges."""
    if not (0 < u < shadow.shape[1] - 1 and 0 < w < shadow.shape[0] - 1):
        return 0.0
    i, j = int(u), int(w)
    p, q = u - i, w - j
    above = shadow[j, i] + p * (shadow[j, i + 1] - shadow[j, i])
    below = shadow[j + 1, i] + p * (shadow[j + 1, i + 1] - shadow[j + 1, i])
    return above + q * (below - above)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _shaded(
    f, x, y, shares, triangles, vertices, normals, colours, shaded, eye, sun, sky, bounce, shadow, veil
):
    """Colour of triangle f at a place in the picture (in samples)."""
    s0 = max(shares[f, 0, 0] * x + shares[f, 0, 1] * y + shares[f, 0, 2], 0.0)
    s1 = max(shares[f, 1, 0] * x + shares[f, 1, 1] * y + shares[f, 1, 2], 0.0)
    s2 = max(shares[f, 2, 0] * x + shares[f, 2, 1] * y + shares[f, 2, 2], 0.0)
    each = (s0, s1, s2)
    whole = 1 / (s0 + s1 + s2)
    px = py = pz = nx = ny = nz = r = g = b = 0.0
    for i in range(3):
        share, v = each[i] * whole, triangles[f, i]
        px, py, pz = px + share * vertices[v, 0], py + share * vertices[v, 1], pz + share * vertices[v, 2]
        nx, ny, nz = nx + share * normals[v, 0], ny + share * normals[v, 1], nz + share * normals[v, 2]
        r, g, b = r + share * colours[v, 0], g + share * colours[v, 1], b + share * colours[v, 2]
    vx, vy, vz = eye[0] - px, eye[1] - py, eye[2] - pz
    s = 1 / max(math.sqrt(vx * vx + vy * vy + vz * vz), 1e-12)
    vx, vy, vz = vx * s, vy * s, vz * s
    s = 1 / max(math.sqrt(nx * nx + ny * ny + nz * nz), 1e-12)
    facing = (nx * vx + ny * vy + nz * vz) * s
    if facing < 0:  # the back of an open surface, or else the rim of a rounded one
        if _from_behind(f, triangles, vertices, eye):
            s, facing = -s, -facing
        else:
            facing = 0.0
    nx, ny, nz = nx * s, ny * s, nz * s
    toward = nx * sun[0] + ny * sun[1] + nz * sun[2]
    light = max((toward + 0.3) / 1.3, 0.0)
    above = 0.5 + 0.5 * ny
    hx, hy, hz = sun[0] + vx, sun[1] + vy, sun[2] + vz
    s = 1 / max(math.sqrt(hx * hx + hy * hy + hz * hz), 1e-12)
    gloss = max((nx * hx + ny * hy + nz * hz) * s, 0.0)
    gloss = gloss * gloss
    gloss = gloss * gloss
    gloss = gloss * gloss
    gloss = 0.1 * gloss * gloss * gloss
    edge = (1 - facing) * (1 - facing)
    edge = 0.1 * edge * edge * above
    add = gloss + edge
    r = r * (sun[3] * light + bounce[0] + (sky[0] - bounce[0]) * above) + add
    g = g * (sun[3] * light + bounce[1] + (sky[1] - bounce[1]) * above) + add
    b = b * (sun[3] * light + bounce[2] + (sky[2] - bounce[2]) * above) + add
    if shaded[f]:
        fall = py - veil[2]
        u = (px + fall * veil[0] - veil[3]) * veil[5] - 0.5
        w = (pz + fall * veil[1] - veil[4]) * veil[5] - 0.5
        left = 1 - veil[6] * _between(shadow, u, w)
        left = left * left
        r, g, b = r * left, g * left, b * left
    return 255 * math.sqrt(min(r, 1.0)), 255 * math.sqrt(min(g, 1.0)), 255 * math.sqrt(min(b, 1.0))


@numba.njit(inline="always", cache=True)
def _same_surface(triangles, f, g):
    """Whether two triangles are one, or share a corner: then one colour serves for both within a pixel."""
    if f == g:
        return True
    for i in range(3):
        v = triangles[f, i]
        if v == triangles[g, 0] or v == triangles[g, 1] or v == triangles[g, 2]:
            return True
    return False


@numba.njit(cache=True, nogil=True, error_model="numpy")
def shade(
    image,
    ids,
    low,
    high,
    shares,
    triangles,
    vertices,
    normals,
    colours,
    opacities,
    shaded,
    eye,
    sun,
    sky,
    bounce,
    shadow,
    veil,
):
    """Put what samples see over image uint8 [H, W, 3].

    colours [V, 3] are linear (squares of sRGB, nearly), opacities [F]; sun [4] is the unit direction to it
    and its strength; sky and bounce [3] light from above and below. shaded bool [F]: what shadows fall on;
    shadow [rows, columns] is that on a level plane (see `cast`), veil [7] its slant [2], the plane's height,
    the corner [2], cells a metre, and how dark it is. It falls along the light to above and below the plane.
    """
    seen, count = np.empty(4, np.int64), np.empty(4, np.int64)
    xs, ys = np.empty(4), np.empty(4)
    for y in range(image.shape[0]):
        start = min(low[2 * y], low[2 * y + 1]) // 2
        stop = min((max(high[2 * y], high[2 * y + 1]) + 1) // 2, image.shape[1])
        for x in range(start, stop):
            kinds = 0
            f = ids[2 * y, 2 * x]
            if f == ids[2 * y, 2 * x + 1] and f == ids[2 * y + 1, 2 * x] and f == ids[2 * y + 1, 2 * x + 1]:
                if f < 0:
                    continue
                kinds, seen[0], count[0] = 1, f, 4
                xs[0], ys[0] = 8 * x + 4.0, 8 * y + 4.0
            for k in range(4 if kinds == 0 else 0):
                sy, sx = 2 * y + k // 2, 2 * x + k % 2
                f = ids[sy, sx]
                if f < 0:
                    continue
                i = 0
                while i < kinds and not _same_surface(triangles, seen[i], f):
                    i += 1
                if i == kinds:
                    seen[i], count[i], xs[i], ys[i] = f, 0, 0.0, 0.0
                    kinds += 1
                count[i] += 1
                xs[i] += sx + 0.5
                ys[i] += sy + 0.5
            if kinds == 0:
                continue
            r = g = b = share = 0.0
            for i in range(kinds):
                f, n = seen[i], count[i]
                cr, cg, cb = _shaded(
                    f, xs[i] / n, ys[i] / n, shares, triangles, vertices, normals, colours, shaded,
                    eye, sun, sky, bounce, shadow, veil,
                )  # fmt: skip
                weight = 0.25 * n * opacities[f]
                r, g, b, share = r + weight * cr, g + weight * cg, b + weight * cb, share + weight
            image[y, x, 0] = np.uint8(r + (1 - share) * image[y, x, 0] + 0.5)
            image[y, x, 1] = np.uint8(g + (1 - share) * image[y, x, 1] + 0.5)
            image[y, x, 2] = np.uint8(b + (1 - share) * image[y, x, 2] + 0.5)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def clear(depth, ids, low, high):
    """Make the samples that were changed as if they had seen nothing."""
    for y in range(depth.shape[0]):
        for x in range(low[y], high[y]):
            depth[y, x] = 0
            ids[y, x] = NONE
        low[y], high[y] = depth.shape[1], 0


@numba.njit(cache=True, nogil=True, error_model="numpy")
def cast(vertices, triangles, slant, origin, texel, mask):
    """Mark mask [rows of z, columns of x] where triangles shade the level ground.

    slant [2] is how far, in x and z, the light moves while it falls by a metre; origin [2] x, z of the mask's
    corner; texel its metres a cell.
    """
    xs, zs = np.empty(3), np.empty(3)
    for f in range(triangles.shape[0]):
        for i in range(3):
            v = triangles[f, i]
            y = max(vertices[v, 1], 0.0)
            xs[i] = (vertices[v, 0] + slant[0] * y - origin[0]) / texel
            zs[i] = (vertices[v, 2] + slant[1] * y - origin[1]) / texel
        first = max(math.ceil(min(zs) - 0.5), 0)
        last = min(math.floor(max(zs) - 0.5), mask.shape[0] - 1)
        for row in range(first, last + 1):
            left, right = 1e30, -1e30
            for i in range(3):
                j = (i + 1) % 3
                t0, t1 = zs[i] - row - 0.5, zs[j] - row - 0.5
                if (t0 <= 0) != (t1 <= 0):
                    x = xs[i] + (xs[j] - xs[i]) * t0 / (t0 - t1)
                    left, right = min(left, x), max(right, x)
            if left > right:
                continue
            start = max(math.ceil(left - 0.5), 0)
            for column in range(start, min(math.floor(right - 0.5), mask.shape[1] - 1) + 1):
                mask[row, column] = 1


@numba.njit(cache=True, nogil=True, error_model="numpy")
def blur(mask, reach, out):
    """Means of mask over 2 reach + 1 cells along its rows, 0 outside; transposed into out."""
    rows, columns = mask.shape
    scale = np.float32(1 / (2 * reach + 1))
    for y in range(rows):
        total = np.float32(0)
        for x in range(min(reach, columns)):
            total += mask[y, x]
        for x in range(columns):
            if x + reach < columns:
                total += mask[y, x + reach]
            if x - reach - 1 >= 0:
                total -= mask[y, x - reach - 1]
            out[x, y] = total * scale


@numba.njit(inline="always", cache=True)
def _floor(x):
    """The whole number at or below x; unlike the library's, many at once."""
    whole = np.float32(np.int32(x))
    return whole - np.float32(whole > x)


@numba.njit(inline="always", cache=True)
def _grid(u, filtered, width):
    """Share of a stretch of length filtered around u that lies on lines of a width, around whole numbers."""
    half = np.float32(0.5)
    a, b = u + (width - filtered) * half, u + (width + filtered) * half
    fa, fb = _floor(a), _floor(b)
    return ((fb - fa) * width + min(b - fb, width) - min(a - fa, width)) / filtered


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath=True)
def _ground_row(x0, dx, z0, dz, bx, bz, away, ex, ez, spacing, width, cx, cz, radius, lines, fades):
    """Share of lines, and how much of the ground is left, in pixels of one row; all of them float32.

    The ground's place is x0 + x dx, z0 + x dz; from row to row it changes by away times what it is from the
    eye at ex, ez, and by bx, bz.
    """
    one, zero, five = np.float32(1), np.float32(0), np.float32(5)
    fifth, least = one / five, np.float32(1e-6)
    per, per_radius = one / spacing, one / (radius * radius)
    wide, slim = width * per, width * per * np.float32(0.4)
    for x in range(lines.shape[0]):
        step = np.float32(np.int32(x))
        gx, gz = x0 + step * dx, z0 + step * dz
        wx = max((abs(dx) + abs(away * (gx - ex) + bx)) * per, least)
        wz = max((abs(dz) + abs(away * (gz - ez) + bz)) * per, least)
        u, w = gx * per, gz * per
        fine = max(_grid(u, wx, wide), _grid(w, wz, wide))
        coarse = max(_grid(u * fifth, wx * fifth, slim), _grid(w * fifth, wz * fifth, slim))
        lines[x] = max(np.float32(0.6) * fine, coarse)
        gx, gz = gx - cx, gz - cz
        left = max(one - (gx * gx + gz * gz) * per_radius, zero)
        fades[x] = left * left


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _darken(dark, x0, dx, z0, dz, shadow, darkness):
    """How much darker pixels of one row are; places are in the shadow's cells."""
    first, last = 0.0, dark.shape[0] - 1.0
    for start, slope, most in ((x0, dx, shadow.shape[1] - 1), (z0, dz, shadow.shape[0] - 1)):
        if slope == 0:
            last = last if 0 < start < most else -1.0
        else:
            a, b = -start / slope, (most - start) / slope
            first, last = max(first, min(a, b)), min(last, max(a, b))
    dark[:] = 0
    if first > last:
        return
    for x in range(math.ceil(first), math.floor(last) + 1):
        u, w = x0 + x * dx, z0 + x * dz
        dark[x] = darkness * _between(shadow, u, w)


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath=True)
def _paint_row(row, lines, fades, dark, horizon, floor, line, tints):
    """Colours of one row of ground into row uint8 [W, 3]; the rest is float32, tints uint8 [3, W] is work."""
    half, one = np.float32(0.5), np.float32(1)
    for i in range(3):
        far, near, more = horizon[i], floor[i], line[i] - floor[i]
        for x in range(row.shape[0]):
            f = fades[x]
            ground = (one - dark[x]) * (near + lines[x] * more)
            tints[i, x] = np.uint8(np.int32(far + f * (ground - far) + half))
    for x in range(row.shape[0]):
        row[x, 0], row[x, 1], row[x, 2] = tints[0, x], tints[1, x], tints[2, x]


@numba.njit(cache=True, nogil=True, error_model="numpy")
def background(image, eye, axes, focal, level, grid, colours, shadow, corner, texel, darkness):
    """Fill image uint8 [H, W, 3] with sky and ground.

    eye [3]; axes [3, 3] of the camera; focal in pixels; level: whether there is a ground; grid float32 [5]:
    spacing, width of its lines, centre x, z and radius of what is seen (metres); colours float32 [4, 3] of
    zenith, horizon, floor and lines, 0 to 255. shadow [rows, columns], 0 to 1, begins at corner [2] (x, z),
    texel metres a cell.
    """
    height, columns = image.shape[0], image.shape[1]
    right, down, ahead = axes[0], axes[1], axes[2]
    lines, fades = np.empty(columns, np.float32), np.empty(columns, np.float32)
    dark, tints = np.zeros(columns, np.float32), np.empty((3, columns), np.uint8)
    single = np.float32
    shaded = darkness > 0 and min(shadow.shape) > 1
    for y in range(height):
        v = (y + 0.5 - height / 2) / focal
        fall = ahead[1] + v * down[1]
        if not level or fall > -1e-6 or eye[1] <= 0:
            t = min(max(1.6 * fall, 0.0), 1.0)
            for i in range(3):
                shade = np.uint8(colours[1, i] + t * (colours[0, i] - colours[1, i]) + 0.5)
                for x in range(columns):
                    image[y, x, i] = shade
            continue
        far = -eye[1] / fall
        dx, dz = far * right[0] / focal, far * right[2] / focal
        x0 = eye[0] + far * (ahead[0] + v * down[0]) + dx * (0.5 - columns / 2)
        z0 = eye[2] + far * (ahead[2] + v * down[2]) + dz * (0.5 - columns / 2)
        # From row to row the place on the ground moves away from the eye, and with the camera's down.
        away = -down[1] / focal / fall
        bx, bz = far * down[0] / focal, far * down[2] / focal
        _ground_row(
            single(x0), single(dx), single(z0), single(dz), single(bx), single(bz), single(away),
            single(eye[0]), single(eye[2]), grid[0], grid[1], grid[2], grid[3], grid[4], lines, fades,
        )  # fmt: skip
        if shaded:
            sx, sz = (x0 - corner[0]) / texel - 0.5, (z0 - corner[1]) / texel - 0.5
            _darken(dark, sx, dx / texel, sz, dz / texel, shadow, darkness)
        _paint_row(image[y], lines, fades, dark, colours[1], colours[2], colours[3], tints)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def strokes(image, depth, floor, starts, stops, colours, radius, bias, through, near):
    """Draw round-ended strokes over image, hidden by what the samples saw before them.

    starts, stops [S, 3] homogeneous places, in pixels; colours [S, 3], 0 to 255; radius in pixels; bias: the
    share by which they count as nearer than they are; through: how much of them is seen all the same.
    """
    height, columns = image.shape[0], image.shape[1]
    for s in range(starts.shape[0]):
        a, b = starts[s], stops[s]
        if a[2] < near and b[2] < near:
            continue
        t0 = (near - a[2]) / (b[2] - a[2]) if a[2] < near else 0.0
        t1 = (near - a[2]) / (b[2] - a[2]) if b[2] < near else 1.0
        wa, wb = a[2] + t0 * (b[2] - a[2]), a[2] + t1 * (b[2] - a[2])
        ax, ay = (a[0] + t0 * (b[0] - a[0])) / wa, (a[1] + t0 * (b[1] - a[1])) / wa
        bx, by = (a[0] + t1 * (b[0] - a[0])) / wb, (a[1] + t1 * (b[1] - a[1])) / wb
        reach = radius + 1
        first, last = max(min(ay, by) - reach, 0.0), min(max(ay, by) + reach, height - 1.0)
        left, right = max(min(ax, bx) - reach, 0.0), min(max(ax, bx) + reach, columns - 1.0)
        if first > last or left > right:
            continue
        dx, dy = bx - ax, by - ay
        long = dx * dx + dy * dy
        for y in range(int(first), int(last) + 1):
            x0, x1 = left, right
            if abs(dy) > 1e-9:  # the stroke's part near this row
                u, v = (y - reach - ay) / dy, (y + 1 + reach - ay) / dy
                u, v = max(min(u, v), 0.0), min(max(u, v), 1.0)
                x0 = max(min(ax + u * dx, ax + v * dx) - reach, left)
                x1 = min(max(ax + u * dx, ax + v * dx) + reach, right)
            for x in range(int(x0), int(x1) + 1):
                px, py = x + 0.5 - ax, y + 0.5 - ay
                t = min(max((px * dx + py * dy) / long, 0.0), 1.0) if long > 0 else 0.0
                px, py = px - t * dx, py - t * dy
                cover = radius + 0.5 - math.sqrt(px * px + py * py)
                if cover <= 0:
                    continue
                z = (1 / wa + t * (1 / wb - 1 / wa)) * (1 + bias)
                free = 0.0
                for k in range(4):
                    sy, sx = 2 * y + k // 2, 2 * x + k % 2
                    if z > depth[sy, sx] and z > floor[sy]:
                        free += 0.25
                cover = min(cover, 1.0) * min(2 * radius, 1.0) * (free + (1 - free) * through)
                for i in range(3):
                    image[y, x, i] = np.uint8(image[y, x, i] + cover * (colours[s, i] - image[y, x, i]) + 0.5)

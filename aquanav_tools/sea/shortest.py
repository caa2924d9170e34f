"""The shortest way of a disc through a bay of rocks, exact.

Every outline, grown by the clearance to be kept, is made of arcs around its corners and of its sides moved outwards.
The shortest way is made of straight lines that touch two such arcs, and of pieces of the arcs between them. So what is
searched (A*) are the common tangents of circles around the corners; whether one is free is asked only when its turn
comes. A circle passed on its right side is turned about counter-clockwise, which is +1 below; on its left, -1.
"""

from __future__ import annotations

import heapq

import numba
import numpy as np

from aquanav_tools.sea.outlines import clearance_at, is_arc_free, is_segment_free, to_outline, to_segment
from aquanav_tools.sea.sea_map import Goal, Outlines, ShortestPath
from aquanav_tools.types import Array

SLACK = 1e-7
"""Tolerance of clearances, m: far above rounding, far below any boat."""
ANGLE_SLACK = 1e-9
"""Tolerance of directions, as a sine."""
NO_LIMIT = 1 << 62
"""More lines than any bay has."""
BEND_STEP = float(np.radians(5.0))
"""Most that a way drawn in pieces turns at one of its points, rad."""
_FROM_X, _FROM_Y, _TO_X, _TO_Y, _LENGTH, _COST = range(6)


def shortest_path(
    outlines: Outlines, start: Array, goal: Goal, clearance: float, max_lines: int | None = None
) -> ShortestPath | None:
    """Return the shortest way from a (2,) start to the goal, or None where there is none.

    It keeps `clearance` from all rocks and from the bay's edge, m. It is exact where the goal's corners and tolerance
    do: a goal that begins within `clearance` of a rock may be reached by a still shorter way along that rock.
    With `max_lines`, None also means that it was not found among that many lines, which is soon known.

    Raises:
        ValueError: the clearance is not above SLACK; a way without one may pass through a wall of two rocks.
    """
    if not clearance > SLACK:
        raise ValueError(f"A way keeps a clearance above {SLACK:g} m, got {clearance:g}.")
    corners = np.asarray(goal.corners, dtype=np.float64)
    start = np.asarray(start, dtype=np.float64)
    to_goal = _to_goal(corners, float(start[0]), float(start[1]))
    if clearance_at(*outlines, float(start[0]), float(start[1])) < clearance:
        return None
    if to_goal <= goal.tolerance:
        return ShortestPath(start[None], 0.0, clearance)
    lines, circles, last = _search(*outlines, start, corners, clearance, clearance - SLACK, max_lines or NO_LIMIT)
    if last < 0:
        return None
    length = float(lines[last, _COST]) - goal.tolerance
    return ShortestPath(_drawn(lines, circles, last, outlines.corners, clearance, goal.tolerance), length, clearance)


def _drawn(lines: Array, circles: Array, last: int, corners: Array, radius: float, tolerance: float) -> Array:
    """Return the (K, 2) points of the way that ends with a line."""
    chain = [last]
    while circles[chain[-1], 2] >= 0:
        chain.append(int(circles[chain[-1], 2]))
    chain.reverse()
    points = [lines[chain[0], :2]]
    for here, after in zip(chain, [*chain[1:], -1], strict=True):
        points.append(lines[here, 2:4])
        if after >= 0 and radius > 0.0:
            middle, turn_way = corners[circles[here, 0]], circles[here, 1]
            begin, end = (np.arctan2(*(place - middle)[::-1]) for place in (lines[here, 2:4], lines[after, :2]))
            turn = turn_way * ((turn_way * (end - begin) + 1e-6) % (2.0 * np.pi) - 1e-6)
            pieces = int(abs(turn) / BEND_STEP) + 1
            angles = begin + turn * np.arange(1, pieces + 1) / pieces
            points.extend(middle + radius * np.stack([np.cos(angles), np.sin(angles)], axis=1))
    final = points[-1] - points[-2]
    left = np.hypot(*final)
    points[-1] = points[-2] + final * max(1.0 - tolerance / left, 0.0) if left > 0.0 else points[-1]
    return np.array(points)


@numba.njit(cache=True)
def _search(corners, first, discs, edge, start, goal, radius, reach, max_lines):  # type: ignore[no-untyped-def]
    """Return the lines, the circles at their ends, and which line ends the shortest way, -1 for none.

    Lines (M, 6): from, to, length, and length of the way to its end. Circles (M, 3): number, sense, the line before.
    """
    num = len(corners)
    bends, normals = _bends(corners, first, discs, edge, reach)
    net = _first_net(num, len(bends))
    net = _leave(net, corners, bends, normals, start, goal, radius, num, 1)
    is_done, queue = np.zeros(0, dtype=np.bool_), [(0.0, -1)]
    queue.pop()
    for line in range(net[3][0]):
        net[0][line, _COST] = net[0][line, _LENGTH]
        heapq.heappush(queue, (net[0][line, _COST] + _to_goal(goal, net[0][line, 2], net[0][line, 3]), line))
    is_left, room = np.zeros(2 * num, dtype=np.bool_), np.full(num, -1)
    num_tried = 0
    while len(queue) > 0 and num_tried < max_lines:
        _, line = heapq.heappop(queue)
        if len(is_done) < len(net[0]):
            is_done = _lengthened(is_done, len(net[0]))
        ax, ay, bx, by = net[0][line, 0], net[0][line, 1], net[0][line, 2], net[0][line, 3]
        if is_done[line]:
            continue
        is_done[line] = True
        num_tried += 1
        if not is_segment_free(corners, first, discs, edge, ax, ay, bx, by, reach):
            net[0][line, _LENGTH] = np.inf  # so that it is not asked again
            continue
        i, sense = net[1][line, 0], net[1][line, 1]
        if i >= num:
            return net[0], net[1], line
        if not is_left[2 * i + (sense > 0)]:
            is_left[2 * i + (sense > 0)] = True
            net = _leave(net, corners, bends, normals, start, goal, radius, i, sense)
        if room[i] < 0:
            room[i] = _is_roomy(corners, first, discs, edge, i, 2.0 * radius)
        _go_on(net, corners, first, discs, edge, goal, radius, reach, line, room[i] > 0, queue)
    return net[0], net[1], -1


@numba.njit(cache=True)
def _go_on(net, corners, first, discs, edge, goal, radius, reach, line, is_open, queue):  # type: ignore[no-untyped-def]
    """Offer the way that ends with a line to all lines that leave the circle it ends at."""
    lines, circles, after, _, head = net
    i, sense = circles[line, 0], circles[line, 1]
    x, y = corners[i, 0], corners[i, 1]
    begin = np.arctan2(lines[line, 3] - y, lines[line, 2] - x)
    follower = head[2 * i + (sense > 0)]
    while follower >= 0:
        turn = sense * (np.arctan2(lines[follower, 1] - y, lines[follower, 0] - x) - begin)
        turn = (turn + 1e-6) % (2.0 * np.pi) - 1e-6  # rounding must not make a turn by nothing one all the way round
        cost = lines[line, _COST] + radius * max(turn, 0.0) + lines[follower, _LENGTH]
        if turn < np.pi and cost < lines[follower, _COST]:
            if is_open or is_arc_free(corners, first, discs, edge, x, y, radius, begin, sense * turn, reach):
                lines[follower, _COST], circles[follower, 2] = cost, line
                rest = _to_goal(goal, lines[follower, 2], lines[follower, 3])
                heapq.heappush(queue, (cost + rest, follower))
        follower = after[follower]


@numba.njit(cache=True)
def _bends(corners, first, discs, edge, reach):  # type: ignore[no-untyped-def]
    """Return which corners a way may bend around, and the (V, 4) normals of the sides before and after each corner.

    These are corners that point outwards and of which some surrounding is free; corners inside another rock are not.
    """
    bends, normals = np.empty(len(corners), dtype=np.int64), np.empty((len(corners), 4))
    count = 0
    for n in range(len(discs)):
        begin, end = first[n], first[n + 1]
        for here in range(begin, end):
            before = here - 1 if here > begin else end - 1
            follower = here + 1 if here + 1 < end else begin
            for k, a, b in ((0, before, here), (2, here, follower)):
                dx, dy = corners[b, 0] - corners[a, 0], corners[b, 1] - corners[a, 1]
                length = np.hypot(dx, dy)
                normals[here, k], normals[here, k + 1] = dy / length, -dx / length
            turn = normals[here, 0] * normals[here, 3] - normals[here, 1] * normals[here, 2]
            if turn > ANGLE_SLACK and not _is_buried(corners, first, discs, edge, n, here, reach):
                bends[count] = here
                count += 1
    return bends[:count], normals


@numba.njit(cache=True)
def _is_buried(corners, first, discs, edge, own, here, reach):  # type: ignore[no-untyped-def]
    """Return whether a corner lies in another rock or beyond the edge, deeper than `reach`."""
    x, y = corners[here, 0], corners[here, 1]
    if min(x - edge[0], y - edge[1], edge[2] - x, edge[3] - y) < 0.0:
        return True
    for n in range(len(discs)):
        if n != own and np.hypot(x - discs[n, 0], y - discs[n, 1]) < discs[n, 2]:
            if to_outline(corners, first[n], first[n + 1], x, y) < -reach:
                return True
    return False


@numba.njit(cache=True)
def _is_roomy(corners, first, discs, edge, here, room):  # type: ignore[no-untyped-def]
    """Return whether nothing but a corner's own two sides is within `room` of it, so that all its arcs are free."""
    x, y = corners[here, 0], corners[here, 1]
    if min(x - edge[0], y - edge[1], edge[2] - x, edge[3] - y) < room:
        return False
    for n in range(len(discs)):
        if np.hypot(x - discs[n, 0], y - discs[n, 1]) >= discs[n, 2] + room:
            continue
        before = first[n + 1] - 1
        for one in range(first[n], first[n + 1]):
            if one != here and before != here:
                cx, cy, dx, dy = corners[before, 0], corners[before, 1], corners[one, 0], corners[one, 1]
                if to_segment(x, y, cx, cy, dx, dy) < room:
                    return False
            before = one
    return True


@numba.njit(cache=True)
def _first_net(num, num_bends):  # type: ignore[no-untyped-def]
    """Return an empty net of lines: their places, circles, next in the list of their circle, count, heads of lists.

    List 2 i + 1 is of corner i passed counter-clockwise, 2 i clockwise; the last is the start's.
    """
    size = 16 * (num_bends + 4)
    after, head = np.empty(size, dtype=np.int64), np.full(2 * num + 1, -1)
    return np.empty((size, 6)), np.empty((size, 3), dtype=np.int64), after, np.zeros(1, dtype=np.int64), head


@numba.njit(cache=True)
def _leave(net, corners, bends, normals, start, goal, radius, i, sense):  # type: ignore[no-untyped-def]
    """Return the net with the tangents that leave a circle passed in a sense and graze the rocks at both ends.

    Circle i is that of a corner, or the start behind the last of them; the goal is one more.
    """
    num, line = len(corners), np.empty(4)
    own = 0.0 if i == num else sense * radius
    place = start if i == num else corners[i]
    for j in bends:
        for other in (-1, 1):
            if (
                j != i
                and _touch(place, corners[j], own, other * radius, line)
                and _grazes(normals, i, num, sense, line)
            ):
                if _grazes(normals, j, num, other, line):
                    net = _keep(net, line, i, sense, j, other)
    for g in range(len(goal)):
        if _touch(place, goal[g], own, 0.0, line) and _grazes(normals, i, num, sense, line):
            net = _keep(net, line, i, sense, num + 1, 1)
        if len(goal) > 1 and _square_on(place, own, goal[g], goal[(g + 1) % len(goal)], line):
            if _grazes(normals, i, num, sense, line):
                net = _keep(net, line, i, sense, num + 1, 1)
    return net


@numba.njit(cache=True)
def _touch(a, b, m, n, line):  # type: ignore[no-untyped-def]
    """Write the line that touches circles of signed radius m around a and n around b; return whether there is one."""
    dx, dy = b[0] - a[0], b[1] - a[1]
    square, offset = dx * dx + dy * dy, m - n
    if square <= offset * offset:
        return False
    along = np.sqrt(square - offset * offset)
    ux, uy = (along * dx - offset * dy) / square, (along * dy + offset * dx) / square
    line[0], line[1], line[2], line[3] = a[0] + m * uy, a[1] - m * ux, b[0] + n * uy, b[1] - n * ux
    return True


@numba.njit(cache=True)
def _grazes(normals, i, num, sense, line):  # type: ignore[no-untyped-def]
    """Return whether a line touches the circle of corner i between the normals of the corner's sides."""
    if i >= num:
        return True
    dx, dy = line[2] - line[0], line[3] - line[1]
    length = np.hypot(dx, dy)
    if length == 0.0:
        return False
    x, y = sense * dy / length, -sense * dx / length
    before = normals[i, 0] * y - normals[i, 1] * x
    return before >= -ANGLE_SLACK and x * normals[i, 3] - y * normals[i, 2] >= -ANGLE_SLACK


@numba.njit(cache=True)
def _square_on(place, m, a, b, line):  # type: ignore[no-untyped-def]
    """Write the line from a circle of signed radius m that meets the segment from a to b at a right angle, if any."""
    dx, dy = b[0] - a[0], b[1] - a[1]
    length = np.hypot(dx, dy)
    ux, uy = dy / length, -dx / length
    away = (a[0] - place[0]) * ux + (a[1] - place[1]) * uy
    if away < 0.0:
        ux, uy, away = -ux, -uy, -away
    line[0], line[1] = place[0] + m * uy, place[1] - m * ux
    line[2], line[3] = line[0] + away * ux, line[1] + away * uy
    share = ((line[2] - a[0]) * dx + (line[3] - a[1]) * dy) / (length * length)
    return 0.0 <= share <= 1.0


@numba.njit(cache=True)
def _keep(net, line, i, sense, j, other):  # type: ignore[no-untyped-def]
    """Return the net with one more line, from circle i to circle j."""
    lines, circles, after, count, head = net
    n = count[0]
    if n == len(lines):
        lines, circles, after = _doubled(lines, circles, after)
    for k in range(4):
        lines[n, k] = line[k]
    lines[n, _COST] = np.inf
    lines[n, _LENGTH] = np.hypot(line[2] - line[0], line[3] - line[1])
    circles[n, 0], circles[n, 1], circles[n, 2] = j, other, -1
    node = min(2 * i + (sense > 0), len(head) - 1)
    after[n], head[node] = head[node], n
    count[0] += 1
    return lines, circles, after, count, head


@numba.njit(cache=True)
def _lengthened(flags, num):  # type: ignore[no-untyped-def]
    more = np.zeros(num, dtype=np.bool_)
    for n in range(len(flags)):
        more[n] = flags[n]
    return more


@numba.njit(cache=True)
def _doubled(lines, circles, after):  # type: ignore[no-untyped-def]
    """Return the arrays of a net with room for twice its lines.

    In loops: compiling np.concatenate took a third of the time of all functions here.
    """
    num = len(lines)
    more_lines, more_circles = np.empty((2 * num, 6)), np.empty((2 * num, 3), dtype=np.int64)
    more_after = np.empty(2 * num, dtype=np.int64)
    for n in range(num):
        more_after[n] = after[n]
        for k in range(6):
            more_lines[n, k] = lines[n, k]
        for k in range(3):
            more_circles[n, k] = circles[n, k]
    return more_lines, more_circles, more_after


@numba.njit(cache=True)
def _to_goal(goal, x, y):  # type: ignore[no-untyped-def]
    """Return the distance from a point to the goal's corners and sides, m."""
    if len(goal) == 1:
        return np.hypot(x - goal[0, 0], y - goal[0, 1])
    if len(goal) > 2:
        return max(to_outline(goal, 0, len(goal), x, y), 0.0)
    return to_segment(x, y, goal[0, 0], goal[0, 1], goal[1, 0], goal[1, 1])

"use strict";
// Where things have been: the origin's path, flown and to come, and what wing tips traced in
// the last wingbeat. Polylines keep the frames that the eye can tell, and end where the robot is.

class Paths {
  constructor(flight, reach) {
    this.flight = flight;
    this.start = flight.originAt(flight.locate(flight.begin));
    this.group = new THREE.Group();
    const points = this.along(() => [0, 0, 0]), tolerance = 0.002 * reach;
    if (flight.frames > 1 && points.some((k) => Math.abs(k) > 0.02 * reach)) {
      this.ahead = new Trail(points, tolerance, { color: LOOK.ahead, linewidth: 1.2, depthWrite: false });
      this.path = new Trail(points, tolerance, { color: LOOK.path, linewidth: 2.2 });
    }
    const traced = { color: LOOK.trace, linewidth: 1.4, transparent: true, opacity: 0.75 };
    this.traces = flight.frames < 2 ? [] : flight.marks.map(({ body, offset }) => ({
      body, offset, trail: new Trail(this.along((i) => flight.pointAt(i, body, offset)), tolerance, traced),
    }));
    this.trails = [this.ahead, this.path, ...this.traces.map((one) => one.trail)].filter(Boolean);
    if (this.trails.length) this.group.add(...this.trails.map((one) => one.line));
    this.beat = this.framesOfBeat();
  }

  // Points relative to the first origin, (frames, 3), of something relative to the origin.
  along(relative) {
    const { flight, start } = this, points = new Float32Array(3 * flight.frames);
    for (let i = 0; i < flight.frames; i++) {
      const p = relative(i);
      for (let k = 0; k < 3; k++) points[3 * i + k] = flight.origin[3 * i + k] - start[k] + p[k];
    }
    return points;
  }

  framesOfBeat() {
    const { flight } = this;
    const beat = flight.period || 0.1 * (flight.end - flight.begin);
    const step = (flight.end - flight.begin) / Math.max(flight.frames - 1, 1) || 1;
    return Math.max(2, Math.min(Math.round(beat / step), flight.frames - 1));
  }

  update(at) {
    const { flight, start } = this, origin = flight.originAt(at);
    const here = (p) => origin.map((value, k) => value - start[k] + p[k]);
    if (this.path) this.path.between(0, at.frame, here([0, 0, 0]));
    const first = Math.max(0, at.frame - this.beat);
    for (const { body, offset, trail } of this.traces) trail.between(first, at.frame, here(flight.pointWhen(at, body, offset)));
  }

  // Lines stay a dot of the screen wide however coarse it is.
  widen(ratio) {
    for (const { line, width } of this.trails) line.material.linewidth = Math.max(width, 1 / ratio);
  }
}

class Trail {
  constructor(points, tolerance, look) {
    this.points = points;
    this.kept = thinned(points, tolerance);
    const corners = new Float32Array(3 * this.kept.length);
    this.kept.forEach((frame, i) => corners.set(points.subarray(3 * frame, 3 * frame + 3), 3 * i));
    this.line = fatLine(corners, look);
    this.width = look.linewidth;
    this.ends = this.line.geometry.attributes.instanceStart.data;
    this.whole = this.ends.array.slice();
  }

  // From one frame to another and on to a point.
  between(first, last, head) {
    const from = after(this.kept, first), upto = after(this.kept, last);
    const ends = this.ends.array, count = Math.min(upto - from + 1, this.kept.length - 1);
    for (let k = 0; k < 3; k++) ends[k] = this.points[3 * first + k];
    // kept corners from..upto-1 each end one segment and begin the next
    for (let i = from; i < from + count - 1; i++) {
      for (let k = 0; k < 3; k++) ends[6 * (i - from) + 3 + k] = ends[6 * (i - from) + 6 + k] = this.points[3 * this.kept[i] + k];
    }
    for (let k = 0; k < 3; k++) ends[6 * count - 3 + k] = head[k];
    this.line.geometry.instanceCount = count;
    this.ends.needsUpdate = true;
  }
}

// How many numbers of a rising list are not above a value.
function after(list, value) {
  let low = 0, high = list.length;
  while (low < high) {
    const middle = (low + high) >> 1;
    if (list[middle] <= value) low = middle + 1; else high = middle;
  }
  return low;
}

// Corners that a polyline needs to stay within a tolerance (Douglas and Peucker, 1973).
function thinned(points, tolerance) {
  const n = points.length / 3, kept = new Uint8Array(n), parts = [[0, n - 1]];
  kept[0] = kept[n - 1] = 1;
  while (parts.length) {
    const [a, b] = parts.pop();
    const x = points[3 * a], y = points[3 * a + 1], z = points[3 * a + 2];
    const dx = points[3 * b] - x, dy = points[3 * b + 1] - y, dz = points[3 * b + 2] - z;
    const square = dx * dx + dy * dy + dz * dz;
    let far = 0, where = -1;
    for (let i = a + 1; i < b; i++) {
      const ex = points[3 * i] - x, ey = points[3 * i + 1] - y, ez = points[3 * i + 2] - z;
      const part = square ? Math.min(1, Math.max(0, (dx * ex + dy * ey + dz * ez) / square)) : 0;
      const away = Math.hypot(ex - part * dx, ey - part * dy, ez - part * dz);
      if (away > far) [far, where] = [away, i];
    }
    if (far > tolerance) {
      kept[where] = 1;
      parts.push([a, where], [where, b]);
    }
  }
  return [...kept.keys()].filter((i) => kept[i]);
}

function fatLine(points, look) {
  const line = new THREE.Line2(new THREE.LineGeometry().setPositions(points), new THREE.LineMaterial({ ...look, fog: true }));
  line.frustumCulled = false;
  return line;
}

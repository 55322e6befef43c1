"use strict";
const INTERVAL = 1.959963985; // half width of the 95 % interval, in deviations

// The flight as arrays, and what it looks like at any time: between two stored frames
// positions are interpolated linearly and quaternions linearly, then normalized.

class Flight {
  constructor(content) {
    Object.assign(this, content);
    this.time = unpack(content.time);
    this.origin = unpack(content.origin);
    this.position = unpack(content.position);
    this.quaternion = unpack(content.quaternion);
    this.speed = unpack(content.speed);
    this.arrows = content.arrows && Object.fromEntries(
      Object.entries(content.arrows).map(([name, value]) => [name, value && unpack(value)]));
    this.series = content.series.map((one) => ({
      ...one, values: unpack(one.values), predicted: one.predicted && unpack(one.predicted),
      std: one.std && unpack(one.std),
    }));
    this.gaps = new Set(content.gaps); // frames before which samples are missing
    this.frames = this.time.length;
    this.begin = this.time[0];
    this.end = this.time[this.frames - 1];
    this.mean = this.meanPath();
    this.other = content.other && new Flight(content.other);
  }

  // The frame at or before a time, and the part of the way to the next.
  locate(t) {
    let low = 0, high = this.frames - 1;
    while (high - low > 1) {
      const middle = (low + high) >> 1;
      if (this.time[middle] <= t) low = middle; else high = middle;
    }
    if (high === low) return { frame: low, next: low, part: 0 };
    const part = (t - this.time[low]) / (this.time[high] - this.time[low]);
    return { frame: low, next: part > 0 ? high : low, part: Math.min(Math.max(part, 0), 1) };
  }

  // Whether there are samples at a time: it is in no gap, and a frame at most before or after all.
  knows(t) {
    const step = (this.end - this.begin) / Math.max(this.frames - 1, 1), { next, part } = this.locate(t);
    return t >= this.begin - step && t <= this.end + step && !(part > 0 && part < 1 && this.gaps.has(next));
  }

  // Entries [offset, offset + count) of a row of `width` numbers, between frames.
  mix(values, width, offset, count, at, out) {
    const a = at.frame * width + offset, b = at.next * width + offset;
    for (let k = 0; k < count; k++) out[k] = values[a + k] + at.part * (values[b + k] - values[a + k]);
    return out;
  }

  originAt(at, out = [0, 0, 0]) { return this.mix(this.origin, 3, 0, 3, at, out); }

  turnAt(body, at, out = [0, 0, 0, 1]) {
    const width = 4 * this.bodies.length, a = at.frame * width + 4 * body, b = at.next * width + 4 * body;
    const q = this.quaternion;
    let dot = 0, square = 0;
    for (let k = 0; k < 4; k++) dot += q[a + k] * q[b + k];
    const sign = dot < 0 ? -1 : 1;
    for (let k = 0; k < 4; k++) {
      out[k] = q[a + k] + at.part * (sign * q[b + k] - q[a + k]);
      square += out[k] * out[k];
    }
    for (let k = 0; k < 4; k++) out[k] /= Math.sqrt(square);
    return out;
  }

  // A point fixed to a body at a stored frame, relative to the origin of that frame.
  pointAt(frame, body, offset) { return this.pointWhen({ frame, next: frame, part: 0 }, body, offset); }

  // The same between frames.
  pointWhen(at, body, offset) {
    const [x, y, z, w] = this.turnAt(body, at);
    const p = this.mix(this.position, 3 * this.bodies.length, 3 * body, 3, at, [0, 0, 0]);
    const [a, b, c] = offset;
    const u = y * c - z * b + w * a, v = z * a - x * c + w * b, s = x * b - y * a + w * c;
    return [p[0] + a + 2 * (y * s - z * v), p[1] + b + 2 * (z * u - x * s), p[2] + c + 2 * (x * v - y * u)];
  }

  // The origin's path averaged over a wingbeat: what a following camera follows.
  meanPath() {
    const n = this.frames, total = new Float64Array(3 * (n + 1)), mean = new Float64Array(3 * n);
    for (let i = 0; i < 3 * n; i++) total[i + 3] = total[i] + this.origin[i];
    const step = (this.end - this.begin) / Math.max(n - 1, 1) || 1;
    const half = Math.round((this.period || 0) / step / 2);
    for (let i = 0; i < n; i++) {
      const h = Math.min(half, i, n - 1 - i);
      for (let k = 0; k < 3; k++) {
        mean[3 * i + k] = (total[3 * (i + h + 1) + k] - total[3 * (i - h) + k]) / (2 * h + 1);
      }
    }
    return mean;
  }

  // How far the robot reaches from its origin.
  measureReach() {
    let reach = 0;
    for (let i = 0; i < this.frames; i += Math.max(1, Math.floor(this.frames / 50))) {
      for (const { body, offset } of this.marks) reach = Math.max(reach, Math.hypot(...this.pointAt(i, body, offset)));
      for (const { body, center, carrier } of this.solids) if (!carrier) reach = Math.max(reach, Math.hypot(...this.pointAt(i, body, center)));
    }
    return reach || 1;
  }

  meanAt(at, out) { return this.mix(this.mean, 3, 0, 3, at, out); }
}

function unpack({ kind, base64 }) {
  const text = atob(base64), bytes = new Uint8Array(text.length);
  for (let i = 0; i < text.length; i++) bytes[i] = text.charCodeAt(i);
  return kind === "f8" ? new Float64Array(bytes.buffer) : new Float32Array(bytes.buffer);
}

// 1, 2 or 5 times a power of ten, not above x.
function roundDown(x) {
  const power = 10 ** Math.floor(Math.log10(x));
  return power * (x >= 5 * power ? 5 : x >= 2 * power ? 2 : 1);
}

function numberText(x) {
  if (Number.isNaN(x)) return "–";
  if (x === 0) return "0";
  const size = Math.abs(x);
  return minus(size >= 1e-3 && size < 1e4 ? x.toPrecision(3) : x.toExponential(1));
}

function minus(text) { return text.replaceAll("-", "−"); }

function lengthText(meters) {
  const [value, unit] = meters >= 1 ? [meters, "m"] : meters >= 0.01 ? [100 * meters, "cm"] : [1000 * meters, "mm"];
  return `${+value.toPrecision(3)} ${unit}`;
}

// Texts are set when they change: the page is laid out anew for each.
function setText(element, text) {
  if (element.textContent !== text) element.textContent = text;
}

"use strict";
// Quantities over time, each on two canvases: curves, drawn when the span changes, and over
// them the cursor at the time shown, of which only the old and new places are touched.

const ROOM = { left: 46, right: 8, top: 5, bottom: 16 }; // around the curves [px]

class Plot {
  constructor(parent, series, flight, onSeek) {
    this.series = series;
    this.flight = flight;
    this.guesses = series.predicted ? [series.values, series.predicted] : [series.values];
    this.element = document.createElement("figure");
    this.element.className = "plot";
    this.element.innerHTML = "<figcaption><b></b><i></i><span></span></figcaption><div><canvas></canvas><canvas aria-hidden=true></canvas></div>";
    this.element.querySelector("b").textContent = series.name.replaceAll("_", " ");
    this.element.querySelector("i").textContent = `[${series.unit}]`;
    this.readouts = this.guesses.map((_, k) => {
      const readout = document.createElement("em");
      readout.style.color = flight.colors[k];
      this.element.querySelector("span").append(readout);
      return readout;
    });
    [this.canvas, this.curves] = this.element.querySelectorAll("canvas");
    this.canvas.setAttribute("role", "img");
    this.canvas.setAttribute("aria-label", `${series.group}: ${series.name.replaceAll("_", " ")} over time`);
    parent.append(this.element);
    this.range = valueRange(series);
    const seek = (event) => {
      const box = this.canvas.getBoundingClientRect();
      onSeek(this.timeAt(event.clientX - box.left));
    };
    this.canvas.addEventListener("pointerdown", (event) => {
      this.canvas.setPointerCapture(event.pointerId);
      seek(event);
    });
    this.canvas.addEventListener("pointermove", (event) => {
      if (event.buttons) seek(event);
    });
  }

  timeAt(x) {
    const { left, width } = this.area;
    const part = Math.min(Math.max((x - left) / width, 0), 1);
    return this.span[0] + part * (this.span[1] - this.span[0]);
  }

  // Takes its size from the page; asked for all plots at once, before any is drawn.
  measure() {
    const { clientWidth, clientHeight } = this.canvas;
    this.ratio = Math.min(window.devicePixelRatio || 1, 2);
    this.size = [clientWidth, clientHeight];
    const { left, right, top, bottom } = ROOM;
    this.area = { left, top, width: Math.max(clientWidth - left - right, 10), height: Math.max(clientHeight - top - bottom, 10) };
    this.span = undefined;
  }

  draw(t, span, words) {
    const [wide, high] = this.size.map((k) => Math.round(k * this.ratio));
    if (!wide || !high) return;
    if (!this.span || span[0] !== this.span[0] || span[1] !== this.span[1]) {
      this.span = span;
      for (const canvas of [this.canvas, this.curves]) {
        if (canvas.width !== wide) canvas.width = wide;
        if (canvas.height !== high) canvas.height = high;
      }
      this.drawCurves();
    }
    this.drawCursor(t);
    if (words) this.values.forEach((value, k) => setText(this.readouts[k], numberText(value)));
  }

  drawCursor(t) {
    const { left, top, width, height } = this.area, [begin, end] = this.span, colors = this.flight.colors;
    const pen = (this.pen ||= this.canvas.getContext("2d"));
    pen.setTransform(this.ratio, 0, 0, this.ratio, 0, 0);
    if (this.cursor !== undefined) pen.clearRect(this.cursor - 5, 0, 10, this.size[1]);
    this.cursor = left + (width * (t - begin)) / (end - begin || 1);
    pen.fillStyle = "#0b5c94";
    pen.fillRect(this.cursor - 0.75, top, 1.5, height);
    const at = this.flight.locate(t), one = [0], known = this.flight.knows(t);
    this.values = this.guesses.map((curve, k) => {
      const value = known ? this.flight.mix(curve, 1, 0, 1, at, one)[0] : NaN; // no dot is drawn
      pen.fillStyle = colors[k];
      pen.beginPath();
      pen.arc(this.cursor, this.height(value), 2.6, 0, 7);
      pen.fill();
      return value;
    });
  }

  height(value) {
    const { top, height } = this.area, [low, high] = this.range;
    return top + height * (1 - (Math.min(Math.max(value, low), high) - low) / (high - low));
  }

  drawCurves() {
    const pen = this.curves.getContext("2d"), { left, top, width, height } = this.area;
    pen.setTransform(this.ratio, 0, 0, this.ratio, 0, 0);
    pen.clearRect(0, 0, ...this.size);
    pen.font = "10.5px system-ui, sans-serif";
    this.axes(pen, left, top, width, height);
    pen.save();
    pen.beginPath();
    pen.rect(left, top, width, height);
    pen.clip();
    const { values, predicted, std } = this.series, [truth, guess] = this.flight.colors;
    if (std) this.band(pen, predicted, std, guess);
    this.curve(pen, values, truth, 1.5);
    if (predicted) this.curve(pen, predicted, guess, 1.5, [4, 2.5]);
    pen.fillStyle = "#b3261e";
    const [begin, end] = this.span;
    for (const [t] of this.flight.events) pen.fillRect(left + (width * (t - begin)) / (end - begin || 1), top, 1, height);
    pen.restore();
  }

  // Frames of the span with numbers, in stretches without a gap.
  stretches(values) {
    const { flight, span } = this, last = flight.locate(span[1]).next, found = [];
    let stretch = null;
    for (let i = flight.locate(span[0]).frame; i <= last; i++) {
      if (flight.gaps.has(i) || Number.isNaN(values[i])) stretch = null;
      if (Number.isNaN(values[i])) continue;
      if (!stretch) found.push((stretch = []));
      stretch.push(i);
    }
    return found;
  }

  along(i) {
    const { flight, span, area } = this;
    return area.left + (area.width * (flight.time[i] - span[0])) / (span[1] - span[0] || 1);
  }

  curve(pen, values, color, width, dash = []) {
    pen.beginPath();
    for (const stretch of this.stretches(values)) {
      pen.moveTo(this.along(stretch[0]), this.height(values[stretch[0]]));
      for (const i of stretch) pen.lineTo(this.along(i), this.height(values[i]));
    }
    pen.strokeStyle = color;
    pen.lineWidth = width;
    pen.lineJoin = "round";
    pen.setLineDash(dash);
    pen.stroke();
    pen.setLineDash([]);
  }

  // Where a prediction says the value is, 95 times in 100.
  band(pen, values, std, color) {
    pen.beginPath();
    for (const stretch of this.stretches(values)) {
      const first = stretch[0];
      pen.moveTo(this.along(first), this.height(values[first] + INTERVAL * std[first]));
      for (const i of stretch) pen.lineTo(this.along(i), this.height(values[i] + INTERVAL * std[i]));
      for (const i of stretch.reverse()) pen.lineTo(this.along(i), this.height(values[i] - INTERVAL * std[i]));
    }
    pen.fillStyle = color;
    pen.globalAlpha = 0.22;
    pen.fill();
    pen.globalAlpha = 1;
  }

  axes(pen, left, top, width, height) {
    const [low, high] = this.range, step = roundDown((high - low) / 2); // two labels at least, five at most
    pen.textAlign = "right";
    pen.textBaseline = "middle";
    for (let k = Math.ceil(low / step); k * step <= high; k++) {
      const y = this.height(k * step);
      pen.fillStyle = k ? "#e6eaee" : "#b4bec7";
      pen.fillRect(left, y - 0.5, width, 1);
      pen.fillStyle = "#5a6570";
      pen.fillText(tickText(k * step, step), left - 6, y, left - 8); // narrower rather than cut
    }
    pen.textAlign = "center";
    pen.textBaseline = "top";
    const [begin, end] = this.span, stride = tickStep((end - begin) / Math.max(2, width / 90)) || 1;
    const decimals = Math.max(0, -Math.floor(Math.log10(stride)));
    for (let t = stride * Math.ceil(begin / stride - 1e-9); t <= end + 1e-9 * stride; t += stride) {
      const x = left + (width * (t - begin)) / (end - begin || 1);
      pen.fillStyle = "#e6eaee";
      pen.fillRect(x - 0.5, top, 1, height);
      pen.fillStyle = "#5a6570";
      if (x < left + width - 12) pen.fillText(minus(t.toFixed(decimals)), x, top + height + 4);
    }
    pen.textAlign = "right";
    pen.fillText("s", left + width + 6, top + height + 4);
  }
}

// Limits from the truth, so that a prediction that ran away does not flatten it.
function valueRange({ values }) {
  let low = Infinity, high = -Infinity;
  for (const value of values) {
    if (!Number.isFinite(value)) continue;
    low = Math.min(low, value);
    high = Math.max(high, value);
  }
  if (low > high) return [-1, 1];
  const room = 0.12 * (high - low) || 0.1 * Math.abs(high) || 1;
  return [low - room, high + room];
}

// A number with the digits that tell it from those a step away.
function tickText(value, step) {
  if (!value) return "0";
  const size = Math.abs(value), digits = -Math.floor(Math.log10(step));
  const powers = digits > 4 || size >= 1e5, more = powers ? Math.floor(Math.log10(size)) : 0;
  return minus(value[powers ? "toExponential" : "toFixed"](Math.max(0, digits + more)));
}

function tickStep(rough) {
  const power = 10 ** Math.floor(Math.log10(rough));
  return power * ([1, 2, 5].find((k) => k * power >= rough) || 10);
}

// The column of plots, and the choice of what is in it.
class Plots {
  constructor(column, chooser, flight, onSeek) {
    Object.assign(this, { column, flight, onSeek, plots: [] });
    let group = null, list = null;
    for (const series of flight.series) {
      if (series.group !== group) {
        group = series.group;
        const part = document.createElement("fieldset");
        part.innerHTML = "<legend></legend>";
        part.querySelector("legend").textContent = group;
        chooser.append((list = part));
      }
      const label = document.createElement("label"), box = document.createElement("input");
      box.type = "checkbox";
      box.checked = series.shown;
      box.addEventListener("change", () => {
        series.shown = box.checked;
        this.arrange();
      });
      label.append(box, ` ${series.name.replaceAll("_", " ")}`);
      list.append(label);
    }
    this.arrange();
  }

  arrange() {
    this.column.textContent = "";
    this.plots = [];
    let group = null;
    for (const series of this.flight.series.filter((one) => one.shown)) {
      if (series.group !== group) {
        const head = document.createElement("h2");
        head.textContent = group = series.group;
        this.column.append(head);
      }
      this.plots.push(new Plot(this.column, series, this.flight, this.onSeek));
    }
    this.measure();
    if (this.time !== undefined) this.draw(this.time, this.span, true);
  }

  measure() {
    for (const plot of this.plots) plot.measure();
  }

  draw(t, span, words) {
    this.time = t;
    this.span = span;
    for (const plot of this.plots) plot.draw(t, span, words);
  }
}

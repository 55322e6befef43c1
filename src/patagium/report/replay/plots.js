"use strict";
// Quantities over time, each on its own canvas, with a cursor at the time shown.
// The curves are kept as an image; only the cursor is drawn anew as time passes.

class Plot {
  constructor(parent, series, flight, onSeek) {
    this.series = series;
    this.flight = flight;
    this.element = document.createElement("figure");
    this.element.className = "plot";
    this.element.innerHTML = "<figcaption><b></b><i></i><span></span></figcaption><canvas></canvas>";
    this.element.querySelector("b").textContent = series.name.replaceAll("_", " ");
    this.element.querySelector("i").textContent = `[${series.unit}]`;
    this.readout = this.element.querySelector("span");
    this.canvas = this.element.querySelector("canvas");
    this.canvas.setAttribute("role", "img");
    this.canvas.setAttribute("aria-label", `${series.group}: ${series.name} over time`);
    parent.append(this.element);
    this.curves = document.createElement("canvas");
    this.stale = true;
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
    const { left, width } = this.area();
    const part = Math.min(Math.max((x - left) / width, 0), 1);
    return this.span[0] + part * (this.span[1] - this.span[0]);
  }

  area() {
    const width = this.canvas.clientWidth, height = this.canvas.clientHeight;
    return { left: 46, top: 5, width: Math.max(width - 46 - 8, 10), height: Math.max(height - 5 - 16, 10) };
  }

  draw(t, span) {
    const ratio = Math.min(window.devicePixelRatio || 1, 2);
    const wide = Math.round(this.canvas.clientWidth * ratio), high = Math.round(this.canvas.clientHeight * ratio);
    if (!wide || !high) return;
    const moved = !this.span || span[0] !== this.span[0] || span[1] !== this.span[1];
    this.span = span;
    if (this.stale || moved || this.curves.width !== wide || this.curves.height !== high) {
      this.canvas.width = this.curves.width = wide;
      this.canvas.height = this.curves.height = high;
      this.drawCurves(ratio);
      this.stale = false;
    }
    const pen = this.canvas.getContext("2d"), { left, top, width, height } = this.area();
    pen.setTransform(1, 0, 0, 1, 0, 0);
    pen.clearRect(0, 0, wide, high);
    pen.drawImage(this.curves, 0, 0);
    pen.setTransform(ratio, 0, 0, ratio, 0, 0);
    this.cursor = left + (width * (t - span[0])) / (span[1] - span[0] || 1);
    pen.fillStyle = "#0b5c94";
    pen.fillRect(this.cursor - 0.75, top, 1.5, height);
    this.dots(pen, t);
  }

  dots(pen, t) {
    const at = this.flight.locate(t), { values, predicted } = this.series, colors = this.flight.colors, one = [0];
    const words = [];
    for (const [k, curve] of [values, predicted].entries()) {
      if (!curve) continue;
      const value = this.flight.mix(curve, 1, 0, 1, at, one)[0];
      pen.fillStyle = colors[k];
      pen.beginPath();
      pen.arc(this.cursor, this.height(value), 2.6, 0, 7);
      pen.fill();
      words.push(`<em style="color:${colors[k]}">${numberText(value)}</em>`);
    }
    this.readout.innerHTML = words.join(" ");
  }

  height(value) {
    const { top, height } = this.area(), [low, high] = this.range;
    return top + height * (1 - (Math.min(Math.max(value, low), high) - low) / (high - low));
  }

  drawCurves(ratio) {
    const pen = this.curves.getContext("2d"), { left, top, width, height } = this.area();
    pen.setTransform(ratio, 0, 0, ratio, 0, 0);
    pen.clearRect(0, 0, this.canvas.clientWidth, this.canvas.clientHeight);
    pen.font = "10.5px system-ui, sans-serif";
    this.axes(pen, left, top, width, height);
    pen.save();
    pen.beginPath();
    pen.rect(left, top, width, height);
    pen.clip();
    const { values, predicted } = this.series, [truth, guess] = this.flight.colors;
    this.curve(pen, values, truth, 1.5);
    if (predicted) this.curve(pen, predicted, guess, 1.5, [4, 2.5]);
    pen.restore();
  }

  curve(pen, values, color, width, dash = []) {
    const { flight, span } = this, { left, width: wide } = this.area();
    const first = flight.locate(span[0]).frame, last = flight.locate(span[1]).next;
    pen.beginPath();
    for (let i = first; i <= last; i++) {
      const x = left + (wide * (flight.time[i] - span[0])) / (span[1] - span[0] || 1);
      if (i === first) pen.moveTo(x, this.height(values[i])); else pen.lineTo(x, this.height(values[i]));
    }
    pen.strokeStyle = color;
    pen.lineWidth = width;
    pen.lineJoin = "round";
    pen.setLineDash(dash);
    pen.stroke();
    pen.setLineDash([]);
  }

  axes(pen, left, top, width, height) {
    const [low, high] = this.range, step = tickStep((high - low) / 3.6), digits = Math.max(0, -Math.floor(Math.log10(step)));
    pen.fillStyle = "#5a6570";
    pen.textAlign = "right";
    pen.textBaseline = "middle";
    for (let value = step * Math.ceil(low / step); value <= high; value += step) {
      const y = this.height(value), zero = Math.abs(value) < 1e-9 * step;
      pen.fillStyle = zero ? "#b4bec7" : "#e6eaee";
      pen.fillRect(left, y - 0.5, width, 1);
      pen.fillStyle = "#5a6570";
      const text = zero ? "0" : digits > 4 || Math.abs(value) >= 1e5 ? value.toExponential(0) : value.toFixed(digits);
      pen.fillText(text.replace("-", "−"), left - 6, y);
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
      if (x < left + width - 12) pen.fillText(t.toFixed(decimals), x, top + height + 4);
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

function tickStep(rough) {
  const power = 10 ** Math.floor(Math.log10(rough));
  return power * ([1, 2, 5].find((k) => k * power >= rough) || 10);
}

// The column of plots, and the choice of what is in it.
class Plots {
  constructor(column, chooser, flight, onSeek) {
    Object.assign(this, { column, flight, onSeek, plots: new Map() });
    let group = null, list = null;
    flight.series.forEach((series, index) => {
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
    });
    this.arrange();
  }

  arrange() {
    this.column.textContent = "";
    this.plots.clear();
    let group = null;
    for (const series of this.flight.series.filter((one) => one.shown)) {
      if (series.group !== group) {
        const head = document.createElement("h2");
        head.textContent = group = series.group;
        this.column.append(head);
      }
      this.plots.set(series.name, new Plot(this.column, series, this.flight, this.onSeek));
    }
    if (this.time !== undefined) this.draw(this.time, this.span);
  }

  draw(t, span) {
    this.time = t;
    this.span = span;
    for (const plot of this.plots.values()) plot.draw(t, span);
  }
}

"use strict";
// Time: plays, steps, loops; what the buttons and keys do; and what other programs may ask.

const SPEEDS = [1 / 200, 1 / 100, 1 / 50, 1 / 20, 1 / 10, 1 / 5, 1 / 2, 1];
const STILL = 200, WORDS = 100; // ms: at rest after so long; numbers change so often
const flight = new Flight(JSON.parse(document.getElementById("flight").textContent));
const LOOK = flight.look; // colors of things in space
const $ = (id) => document.getElementById(id);

class Player {
  constructor() {
    this.time = flight.begin;
    this.playing = false;
    this.loop = null;
    this.shown = { forces: true, predicted: true, total: false, trail: true };
    this.pace = new Pace();
    this.said = -Infinity;
    this.decimals = Math.max(3, 2 - Math.floor(Math.log10(flight.measureReach()))); // of a height [m]
    this.plots = new Plots($("plots"), $("choice").querySelector("div"), flight, (t) => this.seek(t));
    try {
      this.view = new View($("view"), flight);
    } catch (failure) {
      $("failure").hidden = false;
      for (const part of document.querySelectorAll("#stage nav, #keys, #triad")) part.hidden = true;
      console.warn(`no WebGL: ${failure.message}`);
    }
    this.prepare();
    this.listen();
    this.sayShown();
    this.resize();
    this.seek(this.asked("t") ?? flight.begin);
    const still = matchMedia("(prefers-reduced-motion: reduce)").matches || this.asked("play") === 0;
    if (!still) this.play();
    requestAnimationFrame((now) => this.tick(now));
  }

  // A number from the address, such as replay.html#t=0.5&play=0.
  asked(name) {
    const text = new URLSearchParams(location.hash.slice(1)).get(name);
    return text === null || Number.isNaN(+text) ? undefined : +text;
  }

  prepare() {
    const arrows = flight.arrows;
    $("predicted").hidden = !(arrows && (arrows.predicted || arrows.predicted_total));
    $("loop").hidden = !flight.period;
    $("follow").setAttribute("aria-pressed", Boolean(this.view && this.view.following));
    $("forces").hidden = !(arrows && arrows.force);
    $("total").hidden = !arrows;
    $("colors").hidden = !arrows;
    if (arrows && (!arrows.force || (arrows.predicted_total && !arrows.predicted))) this.shown.total = true;
    for (const value of SPEEDS) $("speed").add(new Option(value === 1 ? "1" : `1/${Math.round(1 / value)}`, value));
    // A wingbeat in about four seconds, or the flight in about ten.
    const wanted = flight.period ? flight.period / 4 : (flight.end - flight.begin) / 10;
    this.speed = SPEEDS.find((value) => value >= 0.8 * wanted) || 1;
    this.setSpeed(this.asked("speed") ?? this.speed);
    $("scrub").min = flight.begin;
    $("scrub").max = flight.end;
  }

  listen() {
    $("play").onclick = () => (this.playing ? this.pause() : this.play());
    $("scrub").oninput = () => {
      this.pause();
      this.seek(+$("scrub").value);
    };
    $("speed").onchange = () => this.setSpeed(+$("speed").value);
    $("loop").onclick = () => this.setLoop(!this.loop);
    $("zoom").onclick = () => this.setZoom(!this.zoomed);
    $("follow").onclick = () => this.view && this.setFollow(!this.view.following);
    for (const name of Object.keys(this.shown)) $(name).onclick = () => this.toggle(name);
    for (const button of document.querySelectorAll("[data-look]")) button.onclick = () => this.look(button.dataset.look);
    $("help").onclick = () => $("keyboard").showModal();
    if (this.view) this.view.controls.addEventListener("change", () => (this.stale = true));
    new ResizeObserver(() => this.resize()).observe($("stage"));
    new ResizeObserver(() => this.resize()).observe($("plots"));
    addEventListener("keydown", (event) => this.key(event));
    addEventListener("hashchange", () => this.seek(this.asked("t") ?? this.time));
  }

  key(event) {
    const at = event.target;
    if (event.ctrlKey || event.metaKey || event.altKey || $("keyboard").open) return;
    if (at.matches("select, input[type=checkbox], summary") || (event.key === " " && at.matches("button"))) return;
    const beat = flight.period || (flight.end - flight.begin) / 10;
    const actions = {
      " ": () => (this.playing ? this.pause() : this.play()),
      ArrowLeft: () => (event.shiftKey ? this.jump(-beat) : this.step(-1)),
      ArrowRight: () => (event.shiftKey ? this.jump(beat) : this.step(1)),
      Home: () => this.seek(flight.begin),
      End: () => this.seek(flight.end),
      ArrowUp: () => this.setSpeed(SPEEDS[Math.min(SPEEDS.indexOf(this.speed) + 1, SPEEDS.length - 1)]),
      ArrowDown: () => this.setSpeed(SPEEDS[Math.max(SPEEDS.indexOf(this.speed) - 1, 0)]),
      l: () => flight.period && this.setLoop(!this.loop),
      z: () => this.setZoom(!this.zoomed),
      c: () => this.view && this.setFollow(!this.view.following),
      f: () => this.toggle("forces"), p: () => this.toggle("predicted"),
      o: () => this.toggle("total"), t: () => this.toggle("trail"),
      1: () => this.look("oblique"), 2: () => this.look("side"), 3: () => this.look("behind"),
      4: () => this.look("above"), 5: () => this.look("all"), "?": () => $("keyboard").showModal(),
    };
    const action = actions[event.key.length === 1 ? event.key.toLowerCase() : event.key];
    if (!action) return;
    event.preventDefault();
    action();
  }

  play() {
    if (this.time >= flight.end) this.seek(flight.begin);
    this.playing = true;
    this.last = undefined;
    this.sayPlaying();
  }

  pause() {
    this.playing = false;
    this.sayPlaying();
  }

  sayPlaying() {
    $("play").classList.toggle("playing", this.playing);
    $("play").setAttribute("aria-label", this.playing ? "Pause" : "Play");
  }

  seek(t) {
    this.time = Math.min(Math.max(t, flight.begin), flight.end);
    this.stale = true;
  }

  step(count) {
    this.pause();
    const { frame, part } = flight.locate(this.time);
    const whole = part > 1 - 1e-9 ? frame + 1 : frame;
    const to = count < 0 && part > 1e-9 && part < 1 - 1e-9 ? frame : whole + count;
    this.seek(flight.time[Math.min(Math.max(to, 0), flight.frames - 1)]);
  }

  jump(seconds) {
    this.seek(this.time + seconds);
    if (this.loop) this.setLoop(true);
  }

  setSpeed(value) {
    this.speed = SPEEDS.reduce((a, b) => (Math.abs(b - value) < Math.abs(a - value) ? b : a));
    $("speed").value = this.speed;
  }

  setLoop(on) {
    this.loop = null;
    if (on) {
      const count = Math.floor((this.time - flight.begin) / flight.period + 1e-9);
      const begin = Math.max(flight.begin, Math.min(flight.begin + count * flight.period, flight.end - flight.period));
      this.loop = [begin, Math.min(begin + flight.period, flight.end)];
    }
    $("loop").setAttribute("aria-pressed", on);
  }

  setZoom(on) {
    this.zoomed = on;
    $("zoom").setAttribute("aria-pressed", on);
    this.stale = true;
  }

  setFollow(on) {
    if (on) this.view.controls.target.set(0, 0, 0);
    const { camera, controls } = this.view;
    if (on && !this.view.following) {
      // keep the line of sight, come back to the robot's neighborhood
      const sight = camera.position.clone().normalize().multiplyScalar(Math.min(camera.position.length(), 8 * this.view.reach));
      camera.position.copy(sight);
      controls.update();
    }
    this.view.following = on;
    $("follow").setAttribute("aria-pressed", on);
    this.stale = true;
  }

  look(name) {
    if (!this.view) return;
    if (name === "all") this.view.lookAtAll(); else this.view.look(name);
    $("follow").setAttribute("aria-pressed", this.view.following);
    this.stale = true;
  }

  toggle(name) {
    this.shown[name] = !this.shown[name];
    this.sayShown();
  }

  sayShown() {
    for (const [name, on] of Object.entries(this.shown)) $(name).setAttribute("aria-pressed", on);
    if (this.view) this.view.show(this.shown);
    this.stale = true;
  }

  resize() {
    if (this.view) this.view.resize();
    this.plots.measure();
    this.stale = true;
  }

  // The span of the plots: all, or three wingbeats around the cursor.
  span() {
    if (this.loop) return this.loop;
    const wide = 3 * (flight.period || (flight.end - flight.begin) / 10);
    if (!this.zoomed || wide >= flight.end - flight.begin) return [flight.begin, flight.end];
    const begin = Math.min(Math.max(this.time - wide / 2, flight.begin), flight.end - wide);
    return [begin, begin + wide];
  }

  tick(now) {
    if (this.playing) {
      const gap = this.last === undefined ? 0 : now - this.last;
      if (gap) this.pace.heed(gap);
      this.last = now;
      this.advance(this.time + (Math.min(gap, 100) / 1000) * this.speed);
    }
    if (this.stale) {
      this.moved = now;
      this.draw(now, false);
    } else if (this.coarse && !this.playing && now - this.moved > STILL) {
      this.draw(now, true);
    }
    requestAnimationFrame((next) => this.tick(next));
  }

  advance(t) {
    if (this.loop) {
      const [begin, end] = this.loop;
      if (t > end || t < begin) t = begin + ((t - begin) % (end - begin));
    } else if (t >= flight.end) {
      this.pause();
    }
    this.seek(t);
  }

  // All at the time shown. Words follow a few times a second while it plays: no eye reads faster.
  draw(now, atRest) {
    const { view, time } = this, words = !this.playing || now - this.said > WORDS;
    this.stale = false;
    this.plots.draw(time, this.span(), words);
    $("scrub").value = time;
    if (words) this.say(now);
    if (view) {
      view.draw(time, atRest ? view.finest : view.usual * this.pace.share);
      this.coarse = view.ratio < view.finest;
      triad($("triad"), view.camera);
      setText($("scales"), view.scales(this.shown));
    }
    this.drawn = time;
  }

  say(now) {
    this.said = now;
    $("scrub").setAttribute("aria-valuetext", `${this.time.toFixed(4)} s`);
    setText($("moment"), this.words());
  }

  words() {
    const at = flight.locate(this.time), origin = flight.originAt(at), one = [0];
    const words = [`t = ${this.time.toFixed(4)} s`];
    if (flight.period) words.push(`beat ${((this.time - flight.begin) / flight.period).toFixed(2)}`);
    const speed = flight.mix(flight.speed, 1, 0, 1, at, one)[0];
    if (!flight.knows(this.time)) words.push("no samples");
    else if (speed > 1e-9) words.push(`${numberText(speed)} m/s`, `z ${minus((+origin[2].toFixed(this.decimals) || 0).toFixed(this.decimals))} m`);
    const past = flight.events.filter(([t]) => t <= this.time);
    if (past.length) words.push(past.at(-1)[1]);
    return words.join("   ");
  }
}

// World axes as the camera sees them.
function triad(canvas, camera) {
  const seenFrom = camera.quaternion.toArray().join();
  if (canvas.dataset.seenFrom === seenFrom) return;
  canvas.dataset.seenFrom = seenFrom;
  const pen = canvas.getContext("2d"), half = canvas.width / 2, turn = camera.quaternion.clone().invert();
  pen.clearRect(0, 0, canvas.width, canvas.height);
  pen.font = "600 22px system-ui, sans-serif";
  pen.textAlign = "center";
  pen.textBaseline = "middle";
  pen.lineWidth = 3.5;
  pen.lineCap = "round";
  const axes = [["x", 1, 0, 0], ["y", 0, 1, 0], ["z", 0, 0, 1]].map(([name, ...axis]) => ({
    name, seen: new THREE.Vector3(...axis).applyQuaternion(turn),
  }));
  axes.sort((a, b) => a.seen.z - b.seen.z);
  for (const { name, seen } of axes) {
    const x = half + 52 * seen.x, y = half - 52 * seen.y;
    pen.strokeStyle = pen.fillStyle = seen.z < -0.3 ? "#8b98a4" : "#3d4954";
    pen.beginPath();
    pen.moveTo(half, half);
    pen.lineTo(x, y);
    pen.stroke();
    pen.fillText(name, half + 69 * seen.x, half - 69 * seen.y);
  }
}

const player = new Player();

// For links into the page and for tests: time [s], positions [m], world axes.
window.replay = {
  get time() { return player.time; },
  get drawn() { return player.drawn; },
  get playing() { return player.playing; },
  get speed() { return player.speed; },
  get following() { return Boolean(player.view && player.view.following); },
  get loop() { return player.loop; },
  times: flight.time,
  marks: flight.marks.map((mark) => mark.name),
  play: () => player.play(),
  pause: () => player.pause(),
  seek: (t) => player.seek(t),
  mark: (index) => player.view.markAt(index),
  // Where a mark is in the picture, across and up: from -1 to 1 if it is in there.
  seen: (index) => {
    const { camera, anchor } = player.view, place = player.view.markAt(index).map((value, k) => value - anchor[k]);
    return new THREE.Vector3(...place).project(camera).toArray().slice(0, 2);
  },
  // Height of the robot over the ground, and the origin of the other flight (null: hidden), as drawn.
  get height() { return player.view.robot.position.z + player.view.anchor[2] - player.view.ground; },
  get other() { return player.view.ghost.visible ? player.view.ghost.position.toArray().map((value, k) => value + player.view.anchor[k]) : null; },
  cursors: () => player.plots.plots.map((plot) => ({ name: plot.series.name, time: plot.timeAt(plot.cursor), x: plot.cursor })),
  // How it is drawn: pixels along an edge of those it could have, and frames a second while it plays.
  get pace() { return { share: player.pace.share, rate: 1000 / player.pace.gap, atRest: !player.playing && !player.stale && !player.coarse }; },
};

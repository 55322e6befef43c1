"use strict";
// The robot in space. The scene's zero is the camera's target (`anchor`), so that single
// precision on the graphics card is enough however far the robot flies.

const LOOK = {
  paper: "#f4f7f9", grid: "#dbe2e8", gridMajor: "#bcc8d1", shadow: "#d3dbe1", bodies: "#8c9aa7",
  upper: "#9fc0d8", lower: "#7d9db6", edge: "#46627a", path: "#7b8894", ahead: "#c6cfd7", trace: "#4f86ad",
};
const DIRECTIONS = { oblique: [-0.72, -0.75, 0.62], side: [0, -1, 0.04], behind: [-1, 0, 0.12], above: [-0.02, 0, 1] };

class View {
  constructor(canvas, flight) {
    this.flight = flight;
    this.canvas = canvas;
    this.renderer = new THREE.WebGLRenderer({ canvas, antialias: true, preserveDrawingBuffer: true });
    this.scene = new THREE.Scene();
    this.scene.background = new THREE.Color(LOOK.paper);
    this.scene.fog = new THREE.Fog(LOOK.paper, 1, 10);
    this.reach = this.measureReach();
    this.ground = this.groundHeight();
    this.anchor = [0, 0, 0];
    this.following = true;
    this.light();
    this.robot = new THREE.Group();
    this.shadow = new THREE.Group();
    this.scene.add(this.shadow, this.robot);
    this.bodies = this.build(this.robot, false);
    this.shadows = this.build(this.shadow, true);
    this.addGround();
    this.addPaths();
    if (flight.arrows) {
      this.forces = new Forces(flight, this.reach);
      this.robot.add(this.forces.group);
    }
    this.camera = new THREE.PerspectiveCamera(32, 1, 0.02 * this.reach, 1);
    this.camera.up.set(0, 0, 1);
    this.controls = new THREE.OrbitControls(this.camera, canvas);
    this.controls.enableDamping = false;
    this.controls.minDistance = 0.6 * this.reach;
    this.look("oblique");
  }

  // How far the robot reaches from its origin.
  measureReach() {
    const { flight } = this;
    let reach = 0;
    for (let i = 0; i < flight.frames; i += Math.max(1, Math.floor(flight.frames / 50))) {
      for (const { body, offset } of flight.marks) reach = Math.max(reach, Math.hypot(...flight.pointAt(i, body, offset)));
      for (const { body, center } of flight.solids) reach = Math.max(reach, Math.hypot(...flight.pointAt(i, body, center)));
    }
    return reach || 1;
  }

  // A round height that the robot never goes below.
  groundHeight() {
    let lowest = Infinity;
    for (let i = 2; i < this.flight.origin.length; i += 3) lowest = Math.min(lowest, this.flight.origin[i]);
    const step = roundDown(0.5 * this.reach);
    return step * Math.floor((lowest - 1.25 * this.reach) / step);
  }

  light() {
    const sun = new THREE.DirectionalLight("#ffffff", 1.7);
    sun.position.set(-0.4, -0.7, 1.4);
    this.scene.add(new THREE.HemisphereLight("#ffffff", "#b9c4cd", 1.75), sun);
  }

  build(parent, flat) {
    const plain = (color) => new THREE.MeshBasicMaterial({ color, side: THREE.DoubleSide, depthWrite: false });
    const shadow = plain(LOOK.shadow);
    const solid = flat ? shadow : new THREE.MeshStandardMaterial({ color: LOOK.bodies, roughness: 0.55, metalness: 0.1 });
    const lit = (color, side) => new THREE.MeshStandardMaterial({
      color, side, roughness: 0.8, transparent: true, opacity: 0.9,
      polygonOffset: true, polygonOffsetFactor: 1, polygonOffsetUnits: 1,
    });
    const skins = flat ? [shadow] : [lit(LOOK.upper, THREE.FrontSide), lit(LOOK.lower, THREE.BackSide)];
    const edge = new THREE.LineBasicMaterial({ color: LOOK.edge, transparent: true, opacity: 0.75 });
    return this.flight.bodies.map((name, body) => {
      const group = new THREE.Group();
      parent.add(group);
      for (const one of this.flight.solids.filter((k) => k.body === body)) {
        const mesh = new THREE.Mesh(solidGeometry(one), solid);
        mesh.position.fromArray(one.center);
        const up = one.kind === "cylinder" || one.kind === "capsule" ? one.axis : [0, 1, 0];
        mesh.quaternion.setFromUnitVectors(new THREE.Vector3(0, 1, 0), new THREE.Vector3(...up).normalize());
        mesh.renderOrder = flat ? 1 : 0;
        group.add(mesh);
      }
      const strips = this.flight.surfaces.filter((k) => k.body === body);
      if (strips.length) {
        const { faces, edges } = stripGeometry(strips);
        for (const skin of skins) {
          const mesh = new THREE.Mesh(faces, skin);
          mesh.renderOrder = 1;
          group.add(mesh);
        }
        if (!flat) group.add(new THREE.LineSegments(edges, edge));
      }
      return group;
    });
  }

  addGround() {
    this.grid = new THREE.Group();
    const wide = 60, minor = [], major = [];
    for (let k = -wide; k <= wide; k++) {
      // in pieces: some drivers drop a line that passes the camera
      for (let i = -wide; i < wide; i += 5) (k % 5 ? minor : major).push(k, i, 0, k, i + 5, 0, i, k, 0, i + 5, k, 0);
    }
    for (const [points, color] of [[minor, LOOK.grid], [major, LOOK.gridMajor]]) {
      const geometry = new THREE.BufferGeometry();
      geometry.setAttribute("position", new THREE.BufferAttribute(new Float32Array(points), 3));
      const lines = new THREE.LineSegments(geometry, new THREE.LineBasicMaterial({ color, depthWrite: false }));
      lines.frustumCulled = false;
      this.grid.add(lines);
    }
    this.scene.add(this.grid);
  }

  // The path of the origin, flown and to come, and what wing tips traced in the last beat.
  addPaths() {
    const { flight } = this, n = flight.frames;
    this.start = [flight.origin[0], flight.origin[1], flight.origin[2]];
    this.paths = new THREE.Group();
    this.traces = new THREE.Group();
    this.scene.add(this.paths, this.traces);
    const relative = new Float32Array(3 * n);
    let moved = 0;
    for (let i = 0; i < 3 * n; i++) {
      relative[i] = flight.origin[i] - this.start[i % 3];
      moved = Math.max(moved, Math.abs(relative[i]));
    }
    if (n > 1 && moved > 0.02 * this.reach) {
      this.ahead = fatLine(relative, { color: LOOK.ahead, linewidth: 1.2, depthWrite: false });
      this.path = fatLine(relative, { color: LOOK.path, linewidth: 2.2 });
      this.paths.add(this.ahead, this.path);
    }
    this.traceFrames = this.framesOfBeat();
    this.tracePoints = n < 2 ? [] : flight.marks.map(({ body, offset }) => {
      const points = new Float32Array(3 * n);
      for (let i = 0; i < n; i++) {
        const p = flight.pointAt(i, body, offset);
        for (let k = 0; k < 3; k++) points[3 * i + k] = flight.origin[3 * i + k] - this.start[k] + p[k];
      }
      const line = fatLine(new Float32Array(3 * (this.traceFrames + 1)), { color: LOOK.trace, linewidth: 1.4, transparent: true, opacity: 0.75 });
      this.traces.add(line);
      return { points, line };
    });
  }

  framesOfBeat() {
    const { flight } = this;
    const beat = flight.period || 0.1 * (flight.end - flight.begin);
    const step = (flight.end - flight.begin) / Math.max(flight.frames - 1, 1) || 1;
    return Math.max(2, Math.min(Math.round(beat / step), flight.frames - 1, 400));
  }

  update(t) {
    const { flight, anchor } = this, at = flight.locate(t);
    if (this.following) flight.meanAt(at, anchor);
    const origin = flight.originAt(at), shift = [0, 0, 0];
    for (let k = 0; k < 3; k++) shift[k] = origin[k] - anchor[k];
    this.robot.position.fromArray(shift);
    this.shadow.position.set(shift[0], shift[1], this.ground - anchor[2]);
    this.shadow.scale.set(1, 1, 0);
    const place = [0, 0, 0], turn = [0, 0, 0, 1];
    this.bodies.forEach((group, body) => {
      flight.mix(flight.position, 3 * flight.bodies.length, 3 * body, 3, at, place);
      flight.turnAt(body, at, turn);
      for (const one of [group, this.shadows[body]]) {
        one.position.fromArray(place);
        one.quaternion.fromArray(turn);
      }
    });
    const from = this.start.map((value, k) => value - anchor[k]);
    this.paths.position.fromArray(from);
    this.traces.position.fromArray(from);
    if (this.path) this.path.geometry.instanceCount = Math.max(at.frame, 1);
    this.trace(at.next);
    if (this.forces) this.forces.update(at);
  }

  trace(frame) {
    const first = Math.max(0, frame - this.traceFrames);
    for (const { points, line } of this.tracePoints) {
      const ends = line.geometry.attributes.instanceStart.data;
      const count = frame - first;
      for (let i = 0; i < count; i++) {
        for (let k = 0; k < 6; k++) ends.array[6 * i + k] = points[3 * (first + i) + k];
      }
      line.geometry.instanceCount = count;
      ends.needsUpdate = true;
    }
  }

  draw() {
    const { camera, controls } = this;
    controls.update();
    const distance = camera.position.distanceTo(controls.target);
    camera.near = 0.02 * distance;
    camera.far = 60 * distance;
    this.scene.fog.near = 2.2 * distance;
    this.scene.fog.far = 14 * distance;
    this.square = roundDown(0.16 * distance);
    this.grid.scale.setScalar(this.square);
    const snap = 5 * this.square;
    const target = controls.target.toArray().map((value, k) => value + this.anchor[k]);
    this.grid.position.set(
      snap * Math.round(target[0] / snap) - this.anchor[0],
      snap * Math.round(target[1] / snap) - this.anchor[1],
      this.ground - this.anchor[2],
    );
    camera.updateProjectionMatrix();
    this.renderer.render(this.scene, camera);
  }

  resize() {
    const { clientWidth, clientHeight } = this.canvas.parentElement;
    if (!clientWidth || !clientHeight) return;
    this.renderer.setPixelRatio(Math.min(window.devicePixelRatio, 2));
    this.renderer.setSize(clientWidth, clientHeight, false);
    this.camera.aspect = clientWidth / clientHeight;
    this.camera.updateProjectionMatrix();
  }

  // The robot from a side, large enough to be whole.
  look(name) {
    const aspect = Math.min(this.camera.aspect || 1, 1.6);
    const distance = (3.4 * this.reach) / Math.min(1, 0.75 * aspect + 0.1);
    const direction = new THREE.Vector3(...DIRECTIONS[name]).normalize();
    this.controls.target.set(0, 0, 0);
    if (!this.following) this.controls.target.copy(this.robot.position);
    this.camera.position.copy(this.controls.target).addScaledVector(direction, distance);
    this.controls.update();
  }

  // All of the path, from a fixed place.
  lookAtAll() {
    const { origin, frames } = this.flight, low = [1e99, 1e99, 1e99], high = [-1e99, -1e99, -1e99];
    for (let i = 0; i < 3 * frames; i++) {
      low[i % 3] = Math.min(low[i % 3], origin[i]);
      high[i % 3] = Math.max(high[i % 3], origin[i]);
    }
    this.following = false;
    this.anchor = low.map((value, k) => (value + high[k]) / 2);
    const radius = Math.hypot(...low.map((value, k) => (high[k] - value) / 2)) + this.reach;
    this.controls.target.set(0, 0, 0);
    this.camera.position.set(-0.25, -1, 0.3).normalize().multiplyScalar((2.1 * radius) / Math.min(1, this.camera.aspect));
    this.controls.update();
  }

  // Where a mark of the drawn robot is in the world.
  markAt(index) {
    const { body, offset } = this.flight.marks[index];
    this.robot.updateWorldMatrix(true, true);
    const point = new THREE.Vector3(...offset).applyMatrix4(this.bodies[body].matrixWorld);
    return point.toArray().map((value, k) => value + this.anchor[k]);
  }
}

function fatLine(points, look) {
  const line = new THREE.Line2(new THREE.LineGeometry().setPositions(points), new THREE.LineMaterial({ ...look, fog: true }));
  line.frustumCulled = false;
  return line;
}

function stripGeometry(strips) {
  const faces = [], edges = [];
  for (const { corners: [a, b, c, d] } of strips) {
    faces.push(...[a, b, c, a, c, d].flat());
    edges.push(...[a, b, b, c, c, d, d, a].flat());
  }
  const [filled, outlined] = [faces, edges].map((points) => {
    const geometry = new THREE.BufferGeometry();
    geometry.setAttribute("position", new THREE.BufferAttribute(new Float32Array(points), 3));
    return geometry;
  });
  filled.computeVertexNormals();
  return { faces: filled, edges: outlined };
}

function solidGeometry({ kind, size }) {
  if (kind === "box") return new THREE.BoxGeometry(...size);
  if (kind === "ellipsoid") return new THREE.SphereGeometry(1, 28, 18).scale(...size);
  if (kind === "capsule") return new THREE.CapsuleGeometry(size[0], size[1], 8, 16);
  const [radius, length] = size, fillet = Math.min(0.18 * radius, 0.2 * length), profile = [[0, -length / 2]];
  for (const side of [-1, 1]) {
    for (let k = 0; k <= 6; k++) {
      const angle = ((side < 0 ? 6 - k : k) / 6) * (Math.PI / 2);
      profile.push([radius - fillet + fillet * Math.cos(angle), side * (length / 2 - fillet + fillet * Math.sin(angle))]);
    }
  }
  profile.push([0, length / 2]);
  return new THREE.LatheGeometry(profile.map(([r, y]) => new THREE.Vector2(r, y)), 40);
}

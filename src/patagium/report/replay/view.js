"use strict";
// The robot in space. The scene's zero is the camera's target (`anchor`), so that single
// precision on the graphics card is enough however far the robot flies.

const MOST_DOTS = 3e6; // of a picture at rest that the processor draws
const DIRECTIONS = { oblique: [-0.72, -0.75, 0.62], side: [0, -1, 0.04], behind: [-1, 0, 0.12], above: [-0.02, 0, 1] };

class View {
  constructor(canvas, flight) {
    this.flight = flight;
    this.canvas = canvas;
    this.software = drawsInSoftware();
    this.renderer = new THREE.WebGLRenderer({ canvas, antialias: !this.software, preserveDrawingBuffer: true });
    this.scene = new THREE.Scene();
    this.scene.background = new THREE.Color(LOOK.paper);
    this.scene.fog = new THREE.Fog(LOOK.paper, 1, 10);
    this.reach = flight.measureReach();
    this.ground = this.groundHeight();
    this.anchor = [0, 0, 0];
    this.following = true;
    this.light();
    this.robot = new THREE.Group();
    this.shadow = new THREE.Group();
    this.scene.add(this.shadow, this.robot);
    this.bodies = this.build(flight, this.robot, false);
    this.shadows = this.build(flight, this.shadow, true);
    if (flight.other) this.addOther();
    this.addGround();
    this.paths = new Paths(flight, this.reach);
    this.scene.add(this.paths.group);
    if (flight.arrows) {
      this.forces = new Forces(flight, this.reach);
      this.robot.add(this.forces.group);
    }
    this.camera = new THREE.PerspectiveCamera(32, 1, 0.02 * this.reach, 1);
    this.camera.up.set(0, 0, 1);
    this.controls = new THREE.OrbitControls(this.camera, canvas);
    this.controls.enableDamping = false;
    this.controls.minDistance = 0.6 * this.reach;
    this.resize();
    if (flight.ground === null) this.look("oblique"); else this.lookAtAll();
  }

  // Where an arm stands, or a round height that the robot never goes below. Under a robot that
  // rises or falls far the ground follows, so that there always is one.
  groundHeight() {
    if (this.flight.ground !== null) return this.flight.ground;
    let lowest = Infinity, highest = -Infinity;
    for (let i = 2; i < this.flight.origin.length; i += 3) {
      lowest = Math.min(lowest, this.flight.origin[i]);
      highest = Math.max(highest, this.flight.origin[i]);
    }
    this.groundFollows = highest - lowest > 3 * this.reach;
    const step = roundDown(0.5 * this.reach);
    return step * Math.floor((lowest - 1.25 * this.reach) / step);
  }

  light() {
    const sun = new THREE.DirectionalLight("#ffffff", 1.7);
    sun.position.set(-0.4, -0.7, 1.4);
    this.scene.add(new THREE.HemisphereLight("#ffffff", "#b9c4cd", 1.75), sun);
  }

  // Another flight, drawn as one colored ghost.
  addOther() {
    this.other = this.flight.other;
    this.ghost = new THREE.Group();
    this.scene.add(this.ghost);
    this.ghosts = this.build(this.other, this.ghost, true);
    const look = { color: this.flight.colors[1], transparent: true, opacity: 0.45, side: THREE.DoubleSide };
    const skin = new THREE.MeshLambertMaterial(look);
    this.ghost.traverse((one) => { if (one.isMesh) Object.assign(one, { material: skin, renderOrder: 2 }); });
    this.otherPaths = new Paths(this.other, this.reach);
    this.scene.add(this.otherPaths.group);
  }

  build(flight, parent, flat) {
    const plain = (color) => new THREE.MeshBasicMaterial({ color, side: THREE.DoubleSide, depthWrite: false });
    const shadow = plain(LOOK.shadow);
    const [own, carriers] = [LOOK.bodies, LOOK.carrier].map((color) => (flat ? shadow : new THREE.MeshLambertMaterial({ color })));
    const lit = (color, side) => new THREE.MeshLambertMaterial({
      color, side, transparent: true, opacity: 0.9,
      polygonOffset: true, polygonOffsetFactor: 1, polygonOffsetUnits: 1,
    });
    const skins = flat ? [shadow] : [lit(LOOK.upper, THREE.FrontSide), lit(LOOK.lower, THREE.BackSide)];
    const edge = new THREE.LineBasicMaterial({ color: LOOK.edge, transparent: true, opacity: 0.75 });
    return flight.bodies.map((name, body) => {
      const group = new THREE.Group();
      parent.add(group);
      for (const one of flight.solids.filter((k) => k.body === body)) {
        const mesh = new THREE.Mesh(solidGeometry(one, flat), one.carrier ? carriers : own);
        mesh.position.fromArray(one.center);
        const up = one.kind === "cylinder" || one.kind === "capsule" ? one.axis : [0, 1, 0];
        mesh.quaternion.setFromUnitVectors(new THREE.Vector3(0, 1, 0), new THREE.Vector3(...up).normalize());
        mesh.renderOrder = flat ? 1 : 0;
        group.add(mesh);
      }
      const strips = flight.surfaces.filter((k) => k.body === body);
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

  update(t) {
    const { flight, anchor } = this, at = flight.locate(t);
    if (this.following) flight.meanAt(at, anchor);
    if (this.groundFollows) this.ground = flight.meanAt(at, [0, 0, 0])[2] - 1.6 * this.reach;
    const origin = flight.originAt(at), shift = [0, 0, 0];
    for (let k = 0; k < 3; k++) shift[k] = origin[k] - anchor[k];
    this.robot.position.fromArray(shift);
    this.shadow.position.set(shift[0], shift[1], this.ground - anchor[2]);
    this.shadow.scale.set(1, 1, 0);
    pose(flight, at, this.bodies, this.shadows);
    if (this.other) {
      const when = this.other.locate(t), place = this.other.originAt(when);
      this.ghost.visible = this.other.knows(t);
      this.ghost.position.fromArray(place.map((value, k) => value - anchor[k]));
      pose(this.other, when, this.ghosts);
      this.place(this.otherPaths, when);
    }
    this.place(this.paths, at);
    if (!this.forces) return;
    this.forces.group.visible = flight.knows(t);
    this.forces.update(at);
  }

  place(paths, at) {
    const { group, start } = paths;
    group.position.fromArray(start.map((value, k) => value - this.anchor[k]));
    if (group.visible) paths.update(at);
  }

  show(shown) {
    for (const paths of [this.paths, this.otherPaths]) if (paths) paths.group.visible = shown.trail;
    if (this.forces) this.forces.show(shown);
  }

  scales(shown) {
    const forces = this.forces ? this.forces.legend(this.reach, shown) : "";
    const ground = `grid ${lengthText(this.square)}${this.groundFollows ? ", follows" : ""}`;
    return [forces, ground].filter(Boolean).join(" · ");
  }

  // The robot at a time, with so many dots to a pixel of the page along an edge.
  draw(t, ratio) {
    const { camera, controls } = this;
    this.setRatio(ratio);
    this.update(t);
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

  setRatio(ratio) {
    if (ratio === this.ratio) return;
    this.ratio = ratio;
    this.renderer.setPixelRatio(ratio);
    for (const paths of [this.paths, this.otherPaths]) if (paths) paths.widen(ratio);
  }

  resize() {
    const { clientWidth, clientHeight } = this.canvas;
    if (!clientWidth || !clientHeight) return;
    const wanted = window.devicePixelRatio || 1;
    this.usual = Math.min(wanted, this.software ? 1 : 2);
    // without smoothed edges, more dots at rest make them smooth
    this.finest = this.software ? Math.max(1, Math.min(2, Math.sqrt(MOST_DOTS / (clientWidth * clientHeight)))) : this.usual;
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

  // All of the path, and the arm where there is one, from a fixed place.
  lookAtAll() {
    const { ground } = this.flight, carried = ground !== null, points = carried ? [[0, 0, ground]] : [];
    for (const { origin } of [this.flight, this.other ?? this.flight]) {
      for (let i = 0; i < origin.length; i += 3) points.push([...origin.slice(i, i + 3)]);
    }
    this.following = false;
    this.anchor = [0, 1, 2].map((k) => {
      const values = points.map((point) => point[k]);
      return (values.reduce((a, b) => Math.min(a, b)) + values.reduce((a, b) => Math.max(a, b))) / 2;
    });
    const { camera, controls, reach } = this;
    controls.target.set(0, 0, 0);
    camera.position.set(...(carried ? [0.8, -1, 0.4] : [-0.25, -1, 0.3])).normalize();
    // so far that the robot is in the picture wherever on its path it is
    const away = camera.position.clone(), across = new THREE.Vector3(0, 0, 1).cross(away).normalize();
    const up = away.clone().cross(across), high = Math.tan((camera.fov / 360) * Math.PI), wide = high * camera.aspect;
    let distance = 0;
    for (const point of points) {
      const at = new THREE.Vector3(...point.map((value, k) => value - this.anchor[k]));
      const needed = Math.max((Math.abs(at.dot(across)) + reach) / wide, (Math.abs(at.dot(up)) + reach) / high);
      distance = Math.max(distance, at.dot(away) + needed);
    }
    camera.position.multiplyScalar(1.05 * distance);
    controls.update();
  }

  // Where a mark of the drawn robot is in the world.
  markAt(index) {
    const { body, offset } = this.flight.marks[index];
    this.robot.updateWorldMatrix(true, true);
    const point = new THREE.Vector3(...offset).applyMatrix4(this.bodies[body].matrixWorld);
    return point.toArray().map((value, k) => value + this.anchor[k]);
  }
}

// Bodies of a flight at a time, in groups that show them.
function pose(flight, at, ...shown) {
  const place = [0, 0, 0], turn = [0, 0, 0, 1];
  for (let body = 0; body < flight.bodies.length; body++) {
    flight.mix(flight.position, 3 * flight.bodies.length, 3 * body, 3, at, place);
    flight.turnAt(body, at, turn);
    for (const groups of shown) {
      groups[body].position.fromArray(place);
      groups[body].quaternion.fromArray(turn);
    }
  }
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

// A shadow is flat and needs half the corners.
function solidGeometry({ kind, size }, flat) {
  const fine = flat ? 0.5 : 1;
  if (kind === "box") return new THREE.BoxGeometry(...size);
  if (kind === "ellipsoid") return new THREE.SphereGeometry(1, 24 * fine, 14 * fine).scale(...size);
  if (kind === "capsule") return new THREE.CapsuleGeometry(size[0], size[1], 4 * fine, 14 * fine, 1);
  const [radius, length] = size, fillet = Math.min(0.18 * radius, 0.2 * length), profile = [[0, -length / 2]];
  const corners = 4 * fine;
  for (const side of [-1, 1]) {
    for (let k = 0; k <= corners; k++) {
      const angle = ((side < 0 ? corners - k : k) / corners) * (Math.PI / 2);
      profile.push([radius - fillet + fillet * Math.cos(angle), side * (length / 2 - fillet + fillet * Math.sin(angle))]);
    }
  }
  profile.push([0, length / 2]);
  return new THREE.LatheGeometry(profile.map(([r, y]) => new THREE.Vector2(r, y)), 32 * fine);
}

"use strict";
// Forces as arrows: one instance a force, shaft and head. The predicted ones are a wide
// translucent halo around the true ones, so that agreement is seen as well as error.

class Arrows {
  constructor(count, color, { thickness, halo }) {
    const look = { color, fog: false, transparent: true, opacity: halo ? 0.62 : 1, depthWrite: !halo };
    const material = new THREE.MeshBasicMaterial(look);
    const shaft = new THREE.CylinderGeometry(1, 1, 1, 8, 1, true).translate(0, 0.5, 0);
    const head = new THREE.ConeGeometry(1, 1, 12).translate(0, 0.5, 0);
    this.shafts = new THREE.InstancedMesh(shaft, material, count);
    this.heads = new THREE.InstancedMesh(head, material, count);
    this.group = new THREE.Group();
    this.group.add(this.shafts, this.heads);
    for (const mesh of [this.shafts, this.heads]) {
      mesh.frustumCulled = false;
      mesh.renderOrder = halo ? 3 : 4;
    }
    this.thickness = thickness;
    this.halo = halo ? 0.9 : 0; // in thicknesses, around shaft and head
    this.up = new THREE.Vector3(0, 1, 0);
    this.scratch = {
      turn: new THREE.Quaternion(), along: new THREE.Vector3(), at: new THREE.Vector3(),
      size: new THREE.Vector3(), matrix: new THREE.Matrix4(),
    };
  }

  set(index, point, force, metersPerNewton) {
    const { turn, along, at, size, matrix } = this.scratch;
    along.fromArray(force);
    const newton = along.length(), length = newton * metersPerNewton, width = this.thickness;
    const hidden = !(length > 0.2 * width);
    const head = hidden ? 0 : Math.min(7 * width, 0.5 * length);
    if (!hidden) turn.setFromUnitVectors(this.up, along.divideScalar(newton));
    at.fromArray(point);
    const thin = hidden ? 0 : Math.min(1, length / (8 * width)) * width;
    const shaft = (1 + this.halo) * thin, cap = (2.8 + 1.5 * this.halo) * thin, tip = head + this.halo * thin;
    this.shafts.setMatrixAt(index, matrix.compose(at, turn, size.set(shaft, length - head, shaft)));
    at.addScaledVector(along, hidden ? 0 : length - head - 0.4 * this.halo * thin);
    this.heads.setMatrixAt(index, matrix.compose(at, turn, size.set(cap, tip, cap)));
  }

  done() {
    this.shafts.instanceMatrix.needsUpdate = true;
    this.heads.instanceMatrix.needsUpdate = true;
  }
}

// All arrows of a flight; lengths are proportional to forces, one scale for all times.
class Forces {
  constructor(flight, reach) {
    const { arrows } = flight;
    this.flight = flight;
    this.strips = flight.surfaces.length;
    this.group = new THREE.Group();
    const [truth, guess] = flight.colors, thickness = 0.005 * reach;
    this.scale = this.stripScale(reach);
    this.totalScale = this.scaleOf(arrows.total, 1, 0.8 * reach);
    const make = (values, count, color, halo, wide) => {
      if (!values) return null;
      const made = new Arrows(count, color, { thickness: wide * thickness, halo });
      this.group.add(made.group);
      return made;
    };
    this.kinds = [
      { name: "force", values: arrows.force, count: this.strips, at: arrows.point, total: false,
        drawn: make(arrows.force, this.strips, truth, false, 1) },
      { name: "predicted", values: arrows.predicted, count: this.strips, at: arrows.point, total: false,
        drawn: make(arrows.predicted, this.strips, guess, true, 1) },
      { name: "total", values: arrows.total, count: 1, at: arrows.center, total: true,
        drawn: make(arrows.total, 1, truth, false, 1.8) },
      { name: "predicted_total", values: arrows.predicted_total, count: 1, at: arrows.center, total: true,
        drawn: make(arrows.predicted_total, 1, guess, true, 1.8) },
    ];
    this.scratch = [[0, 0, 0], [0, 0, 0]];
  }

  stripScale(reach) { return this.scaleOf(this.flight.arrows.force, this.strips, 0.8 * reach); }

  // Meters a newton, to one digit, such that the largest force but the top 2 % has about a length.
  scaleOf(values, count, length) {
    const sizes = [];
    const stride = Math.max(1, Math.floor(values.length / 3 / 20000));
    for (let i = 0; i < values.length / 3; i += stride) {
      const size = Math.hypot(values[3 * i], values[3 * i + 1], values[3 * i + 2]);
      if (Number.isFinite(size)) sizes.push(size);
    }
    sizes.sort((a, b) => a - b);
    const large = sizes[Math.floor(0.98 * (sizes.length - 1))] || 1;
    return Number((length / large).toPrecision(1));
  }

  show({ forces, predicted, total }) {
    for (const kind of this.kinds) {
      if (!kind.drawn) continue;
      const guess = kind.name.startsWith("predicted");
      kind.drawn.group.visible = (guess ? predicted : true) && (kind.total ? total : forces);
    }
  }

  update(at) {
    const [point, force] = this.scratch;
    for (const { values, count, at: points, drawn, total } of this.kinds) {
      if (!drawn || !drawn.group.visible) continue;
      for (let k = 0; k < count; k++) {
        this.flight.mix(points, 3 * count, 3 * k, 3, at, point);
        this.flight.mix(values, 3 * count, 3 * k, 3, at, force);
        drawn.set(k, point, force, total ? this.totalScale : this.scale);
      }
      drawn.done();
    }
  }

  // What a length of arrow means, such as "0.1 N = 12 cm".
  legend(reach, { forces, total }) {
    const words = [];
    const say = (what, scale) => {
      const newton = roundDown((0.6 * reach) / scale);
      words.push(`${what}: ${+newton.toPrecision(1)} N = ${lengthText(newton * scale)}`);
    };
    if (forces) say("arrows", this.scale);
    if (total) say("total", this.totalScale);
    return words.join(" · ");
  }
}

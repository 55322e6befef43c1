"use strict";
// Forces as arrows: one instance a force, shaft and head. The predicted ones are a wide
// translucent halo around the true ones, so that agreement is seen as well as error.

class Arrows {
  constructor(count, color, { thickness, halo, heads = 1 }) {
    const look = { color, fog: false, transparent: true, opacity: halo ? 0.62 : 1, depthWrite: !halo };
    const material = new THREE.MeshBasicMaterial(look);
    const shaft = new THREE.CylinderGeometry(1, 1, 1, 8, 1, true).translate(0, 0.5, 0);
    const head = new THREE.ConeGeometry(1, 1, 12).translate(0, 0.5, 0);
    this.count = heads;
    this.shafts = new THREE.InstancedMesh(shaft, material, count);
    this.heads = new THREE.InstancedMesh(head, material, heads * count);
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
    for (let k = 0; k < this.count; k++) {
      this.heads.setMatrixAt(this.count * index + k, matrix.compose(at, turn, size.set(cap, tip, cap)));
      at.addScaledVector(along, hidden ? 0 : -0.8 * head);
    }
  }

  done() {
    this.shafts.instanceMatrix.needsUpdate = true;
    this.heads.instanceMatrix.needsUpdate = true;
  }
}

// All arrows of a flight; lengths are proportional to forces, one scale for all times. A moment
// is an arrow with two heads; where a prediction says how sure it is, its 95 % interval is an
// ellipsoid around the arrow's end, a half axis each for x, y and z.
class Forces {
  constructor(flight, reach) {
    const { arrows } = flight, [truth, guess] = flight.colors, thickness = 0.005 * reach;
    this.flight = flight;
    this.reach = reach;
    this.strips = flight.surfaces.length;
    this.group = new THREE.Group();
    this.scales = {
      strips: arrows.force && this.scaleOf(arrows.force, 0.8 * reach),
      total: this.scaleOf(arrows.total, 0.8 * reach),
      moment: arrows.moment && this.scaleOf(arrows.moment, 0.6 * reach),
    };
    const make = (kind, name, guessed, at, count, wide, heads) => {
      if (!arrows[name]) return [];
      const drawn = new Arrows(count, guessed ? guess : truth, { thickness: wide * thickness, halo: guessed, heads });
      this.group.add(drawn.group);
      return [{ kind, values: arrows[name], guessed, at, count, drawn }];
    };
    this.kinds = [
      ...make("strips", "force", false, arrows.point, this.strips, 1, 1),
      ...make("strips", "predicted", true, arrows.point, this.strips, 1, 1),
      ...make("total", "total", false, arrows.center, 1, 1.8, 1),
      ...make("total", "predicted_total", true, arrows.center, 1, 1.8, 1),
      ...make("moment", "moment", false, arrows.center, 1, 1.3, 2),
      ...make("moment", "predicted_moment", true, arrows.center, 1, 1.3, 2),
    ];
    this.scratch = [[0, 0, 0], [0, 0, 0], [0, 0, 0]];
    if (arrows.std && arrows.predicted_total) {
      const look = { color: guess, transparent: true, opacity: 0.22, depthWrite: false };
      this.interval = new THREE.Mesh(new THREE.SphereGeometry(1, 16, 10), new THREE.MeshBasicMaterial(look));
      this.interval.renderOrder = 2;
      this.group.add(this.interval);
    }
  }

  // Meters a newton, to one digit, such that the largest force but the top 2 % has about a length.
  scaleOf(values, length) {
    const sizes = [], stride = Math.max(1, Math.floor(values.length / 3 / 20000));
    for (let i = 0; i < values.length / 3; i += stride) {
      const size = Math.hypot(values[3 * i], values[3 * i + 1], values[3 * i + 2]);
      if (Number.isFinite(size)) sizes.push(size);
    }
    sizes.sort((a, b) => a - b);
    const large = sizes[Math.floor(0.98 * (sizes.length - 1))] || 1;
    return Number((length / large).toPrecision(1));
  }

  show({ forces, predicted, total }) {
    for (const { kind, guessed, drawn } of this.kinds) {
      drawn.group.visible = (guessed ? predicted : true) && (kind === "strips" ? forces : total);
    }
    this.sure = predicted && total;
  }

  update(at) {
    const [point, force] = this.scratch;
    for (const { kind, values, count, at: points, drawn } of this.kinds) {
      if (!drawn.group.visible) continue;
      for (let k = 0; k < count; k++) {
        this.flight.mix(points, 3 * count, 3 * k, 3, at, point);
        this.flight.mix(values, 3 * count, 3 * k, 3, at, force);
        drawn.set(k, point, force, this.scales[kind]);
      }
      drawn.done();
    }
    if (this.interval) this.spread(at);
  }

  spread(at) {
    const { arrows } = this.flight, [point, force, half] = this.scratch, scale = this.scales.total;
    this.flight.mix(arrows.center, 3, 0, 3, at, point);
    this.flight.mix(arrows.predicted_total, 3, 0, 3, at, force);
    this.flight.mix(arrows.std, 3, 0, 3, at, half);
    this.interval.position.set(...point.map((value, k) => value + scale * force[k]));
    const axes = half.map((value) => Math.max(INTERVAL * scale * value, 1e-9));
    this.interval.scale.set(...axes);
    this.interval.visible = this.sure && Math.max(...axes) < this.reach; // wider, it hides all else
  }

  // What a length of arrow means, such as "0.1 N = 12 cm".
  legend(reach, { forces, total }) {
    const words = [], say = (what, scale, unit) => {
      if (!scale) return;
      const size = roundDown((0.6 * reach) / scale);
      words.push(`${what}: ${+size.toPrecision(1)} ${unit} = ${lengthText(size * scale)}`);
    };
    if (forces) say("arrows", this.scales.strips, "N");
    if (total) say("total", this.scales.total, "N");
    if (total) say("moment", this.scales.moment, "N m");
    return words.join(" · ");
  }
}

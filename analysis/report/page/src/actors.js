// What moves in the scene: the robot, bodies as believed, bodies as they are, and what tells the two apart.

import {
  BufferAttribute, BufferGeometry, Color, Group, Line, LineBasicMaterial, LineSegments, Matrix4, Mesh,
  MeshBasicMaterial, MeshLambertMaterial, Quaternion, SphereGeometry, TubeGeometry, CatmullRomCurve3, Vector3,
} from "three";

import { ghost, meshGeometry, shapeGeometry, solid } from "./models.js";
import { poseAt, within } from "./tracks.js";

export const TOLERANCE = 0.005; // m beyond which belief and truth are said to differ

export class Robot {
  constructor(section) {
    this.group = new Group();
    this.chain = section.chain;
    this.tool = section.tool;
    this.frames = section.links.map(() => new Group());
    this.frames.forEach((frame) => this.group.add(frame));
    for (const model of section.models) {
      const material = new MeshLambertMaterial({ vertexColors: true });
      const mesh = new Mesh(meshGeometry(model), material);
      mesh.castShadow = true;
      mesh.receiveShadow = true;
      mesh.userData.label = model.link;
      this.frames[section.links.indexOf(model.link)].add(mesh);
    }
    this.tcp = new Vector3();
  }

  // Each link stands in the frame of the one before it.
  move(tick, share) {
    const here = new Matrix4();
    const step = new Matrix4();
    const [p, q, one] = [new Vector3(), new Quaternion(), new Vector3(1, 1, 1)];
    this.chain.forEach((track, k) => {
      poseAt(track, tick, share, p, q);
      here.multiply(step.compose(p, q, one));
      here.decompose(this.frames[k].position, this.frames[k].quaternion, new Vector3());
    });
    if (!this.tool) return;
    const frame = this.frames[this.tool.link];
    this.tcp.fromArray(this.tool.at).applyQuaternion(frame.quaternion).add(frame.position);
  }
}

export class Believed {
  constructor(packed) {
    Object.assign(this, packed);
    this.group = new Group();
    this.group.userData = { object: this };
    this.meshes = packed.looks.map((look, k) => {
      const before = packed.looks.findIndex((other) => sameForm(other, look));
      if (before < k) return null;
      const mesh = solid(look);
      this.group.add(mesh);
      return mesh;
    });
    this.meshes.forEach((mesh, k) => {
      if (!mesh) this.meshes[k] = this.meshes[packed.looks.findIndex((other) => sameForm(other, packed.looks[k]))];
    });
  }

  lookAt(tick) {
    const index = this.looks.findLastIndex((look) => look.tick <= tick);
    return Math.max(index, 0);
  }

  move(tick, share) {
    this.group.visible = within(this.present, tick);
    this.isHeld = within(this.held, tick);
    if (!this.group.visible) return;
    const index = this.lookAt(tick);
    this.look = this.looks[index];
    for (const mesh of this.group.children) mesh.visible = mesh === this.meshes[index];
    this.meshes[index].material.emissive.setScalar(this.isHeld ? 0.12 : 0);
    poseAt(this.track, tick, share, this.group.position, this.group.quaternion);
  }
}

function sameForm(a, b) {
  const [one, other] = [a, b].map(({ shape, colour, role }) => JSON.stringify([shape.mesh ? "mesh" : shape, colour, role]));
  return one === other && (!a.shape.mesh || sameMesh(a.shape.mesh, b.shape.mesh));
}

function sameMesh(a, b) {
  return a.vertices.length === b.vertices.length && a.vertices.every((value, k) => value === b.vertices[k]);
}

// A true body, with the line to where it is believed.
export class Truth {
  constructor(packed, believed, lineColour) {
    Object.assign(this, packed);
    this.partner = packed.object === null ? null : believed[packed.object];
    this.group = new Group();
    this.ghost = ghost(packed.shape, lineColour);
    this.ghost.userData = { truth: this };
    const points = new BufferGeometry();
    points.setAttribute("position", new BufferAttribute(new Float32Array(6), 3));
    this.line = new Line(points, new LineBasicMaterial({ color: lineColour, depthTest: false }));
    this.line.renderOrder = 5;
    this.line.frustumCulled = false;
    this.group.add(this.ghost, this.line);
  }

  // `distance` is that to the belief, m; NaN where the robot knows nothing of it, or it is gone.
  move(tick, share) {
    const there = within(this.present, tick);
    const known = Boolean(this.partner?.group.visible);
    this.state = there ? (known ? "both" : "unknown") : known ? "gone" : "none";
    this.distance = NaN;
    this.ghost.visible = there;
    this.line.visible = false;
    if (!there) return;
    poseAt(this.track, tick, share, this.ghost.position, this.ghost.quaternion);
    if (known) {
      const at = this.partner.group.position;
      this.distance = at.distanceTo(this.ghost.position);
      this.line.visible = this.distance > TOLERANCE;
      const points = this.line.geometry.attributes.position;
      points.setXYZ(0, at.x, at.y, at.z);
      points.setXYZ(1, this.ghost.position.x, this.ghost.position.y, this.ghost.position.z);
      points.needsUpdate = true;
    }
    const apart = !known || this.distance > TOLERANCE;
    this.ghost.edges.material.opacity = apart ? 1 : 0.4;
    this.ghost.body.visible = apart;
  }
}

// The path of the motion that is being made, and of those that are not.
export class Paths {
  constructor(plans, lineColour) {
    this.group = new Group();
    this.plans = plans;
    this.colour = lineColour;
    this.shown = null;
  }

  move(time) {
    const plan = this.plans.findLast((one) => one.from <= time && time <= one.to) ?? null;
    if (plan === this.shown) return;
    this.shown = plan;
    this.group.traverse((part) => part.geometry?.dispose());
    this.group.clear();
    if (!plan) return;
    const points = [];
    for (let k = 0; k < plan.path.shape[0]; k += 1) {
      const point = new Vector3().fromArray(plan.path, k * 3);
      if (!points.length || points.at(-1).distanceTo(point) > 1e-4) points.push(point);
    }
    if (points.length < 2) return;
    const material = new MeshBasicMaterial({ color: this.colour });
    const tube = new TubeGeometry(new CatmullRomCurve3(points), Math.min(points.length * 3, 90), 0.0022, 6);
    const goal = new Mesh(new SphereGeometry(0.008, 16, 12), material);
    goal.position.copy(points.at(-1));
    this.group.add(new Mesh(tube, material), goal);
  }
}

// Candidates as the outlines of fingers: where they would stand, and whether they were refused.
export class Choices {
  constructor(choices, accepted, refused) {
    this.group = new Group();
    this.choices = choices;
    this.colours = [new Color(refused), new Color(accepted)];
    this.shown = null;
  }

  move(time) {
    const choice = this.choices.findLast((one) => one.from <= time && time <= one.to) ?? null;
    if (choice === this.shown) return;
    this.shown = choice;
    this.group.traverse((part) => part.geometry?.dispose());
    this.group.clear();
    if (!choice || !choice.accepted.length) return;
    // A hand from its wrist (z = -80 mm) to its finger tips (z = 0), which open along y.
    const hand = [[0, 0, -0.08], [0, 0, -0.05], [0, -0.04, -0.05], [0, 0.04, -0.05], [0, -0.04, -0.05], [0, -0.04, 0], [0, 0.04, -0.05], [0, 0.04, 0]];
    const points = [];
    const colours = [];
    const [p, q] = [new Vector3(), new Quaternion()];
    this.segments = hand.length / 2;
    choice.accepted.forEach((accepted, k) => {
      p.fromArray(choice.poses, k * 7);
      q.fromArray(choice.poses, k * 7 + 3).normalize();
      for (const corner of hand) {
        points.push(...new Vector3(...corner).applyQuaternion(q).add(p).toArray());
        colours.push(...this.colours[accepted].toArray());
      }
    });
    const geometry = new BufferGeometry();
    geometry.setAttribute("position", new BufferAttribute(new Float32Array(points), 3));
    geometry.setAttribute("color", new BufferAttribute(new Float32Array(colours), 3));
    this.group.add(new LineSegments(geometry, new LineBasicMaterial({ vertexColors: true, transparent: true, opacity: 0.9 })));
  }

  // The verdict of the candidate of which this vertex is a corner.
  verdict(vertex) {
    return this.shown.verdicts[Math.floor(vertex / (2 * this.segments))];
  }
}

// What a camera sees, as far as `reach` metres.
export class Frustum {
  constructor(camera, lineColour, reach = 0.8) {
    this.camera = camera;
    this.group = new Group();
    const { width, height, focal, centre } = camera;
    const corner = (u, v) => [((u - centre[0]) / focal[0]) * reach, ((v - centre[1]) / focal[1]) * reach, reach];
    const corners = [corner(0, 0), corner(width, 0), corner(width, height), corner(0, height)];
    const points = [];
    corners.forEach((one, k) => points.push(0, 0, 0, ...one, ...one, ...corners[(k + 1) % 4]));
    const geometry = new BufferGeometry();
    geometry.setAttribute("position", new BufferAttribute(new Float32Array(points), 3));
    this.lines = new LineSegments(geometry, new LineBasicMaterial({ color: lineColour, transparent: true, opacity: 0.45 }));
    this.body = new Mesh(shapeGeometry({ box: [0.05, 0.03, 0.03] }), new MeshLambertMaterial({ color: 0x444a55 }));
    this.group.add(this.lines, this.body);
  }

  move(tick, share) {
    poseAt(this.camera.track, tick, share, this.group.position, this.group.quaternion);
  }
}

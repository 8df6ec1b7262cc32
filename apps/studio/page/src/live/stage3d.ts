// The scene of a run that goes on, with the geometry, light and views of the report.

import { Group, Mesh, MeshLambertMaterial, Object3D, PCFShadowMap, Scene, Sphere, Vector3, WebGLRenderer } from "three";

import { Lighting } from "../../../../../analysis/report/page/src/lighting.js";
import { ghost, meshGeometry, solid } from "../../../../../analysis/report/page/src/models.js";
import { colour, onTheme } from "../../../../../analysis/report/page/src/theme.js";
import { unpack } from "../../../../../analysis/report/page/src/unpacking.js";
import { Views, boundsOf } from "../../../../../analysis/report/page/src/views.js";
import type { Body, LiveState, Pose } from "./state";

Object3D.DEFAULT_UP.set(0, 0, 1);

const SLOW = 35; // ms for a frame

interface Packed {
  models: { link: string }[];
  links: string[];
  tool: { link: number; at: number[] } | null;
  fixed: { id: string; pose: Pose }[];
}

function place(object: Object3D, pose: Pose): void {
  object.position.set(pose[0], pose[1], pose[2]);
  object.quaternion.set(pose[3], pose[4], pose[5], pose[6]);
}

export class LiveStage {
  private readonly renderer: WebGLRenderer;
  private readonly scene = new Scene();
  private readonly lighting: Lighting;
  private readonly frames = new Map<string, Group>();
  private readonly fixed = new Group();
  private readonly believed = new Group();
  private readonly truths = new Group();
  private readonly looks = new Map<string, Promise<object>>();
  private readonly robot: { frames: Group[]; tcp: Vector3; tool: Packed["tool"] };
  private readonly views: Views;
  private readonly observer: ResizeObserver;
  private asked = 0;
  private nextDrawing = 0;
  private closed = false;
  private state: LiveState | null = null;

  static async made(packed: string, host: HTMLElement, tools: HTMLElement): Promise<LiveStage> {
    const { stage } = (await unpack(packed)) as { stage: Packed };
    return new LiveStage(stage, host, tools);
  }

  private constructor(stage: Packed, private readonly host: HTMLElement, private readonly tools: HTMLElement) {
    try {
      this.renderer = new WebGLRenderer({ antialias: true, powerPreference: "low-power" });
    } catch {
      throw new Error("This browser cannot draw in 3-D (WebGL is missing or switched off). The rest of this page works.");
    }
    this.renderer.debug.checkShaderErrors = false; // to ask would be to wait for them
    this.renderer.shadowMap.enabled = true;
    this.renderer.shadowMap.type = PCFShadowMap;
    this.renderer.setPixelRatio(Math.min(devicePixelRatio, 2));
    const canvas = this.renderer.domElement;
    canvas.tabIndex = 0;
    canvas.setAttribute("role", "img");
    canvas.setAttribute("aria-label", "The scene in 3-D; drag to turn, wheel or two fingers to zoom");
    host.append(canvas);
    this.lighting = new Lighting(this.scene);
    for (const part of stage.fixed) {
      const mesh = solid({ ...part, role: "fixed" });
      mesh.castShadow = true;
      place(mesh, part.pose);
      this.fixed.add(mesh);
    }
    const arm = new Group();
    for (const link of stage.links) {
      const frame = new Group();
      this.frames.set(link, frame);
      arm.add(frame);
    }
    for (const model of stage.models) {
      const mesh = new Mesh(meshGeometry(model), new MeshLambertMaterial({ vertexColors: true }));
      mesh.castShadow = mesh.receiveShadow = true;
      this.frames.get(model.link)?.add(mesh);
    }
    this.robot = { frames: [...this.frames.values()], tcp: new Vector3(), tool: stage.tool };
    this.scene.add(this.fixed, arm, this.believed, this.truths);
    this.views = new Views(canvas, { robot: this.robot, frusta: [], bounds: this.bounds() }, () => this.request());
    tools.replaceChildren(this.views.chooser);
    onTheme(() => {
      if (this.closed) return;
      this.lighting.theme();
      this.request();
    });
    this.observer = new ResizeObserver(() => this.resize());
    this.observer.observe(host);
  }

  show(state: LiveState): void {
    this.state = state;
    const before = this.robot.tcp.clone();
    for (const [link, pose] of Object.entries(state.frames)) {
      const frame = this.frames.get(link);
      if (frame) place(frame, pose);
    }
    const { tool } = this.robot;
    const frame = tool && this.robot.frames[tool.link];
    if (tool && frame) this.robot.tcp.fromArray(tool.at).applyQuaternion(frame.quaternion).add(frame.position);
    this.views.follow(this.robot.tcp.clone().sub(before));
    this.update(this.believed, state.belief, state, (look) => solid(look as never));
    this.update(this.truths, state.truth, state, (look) => ghost((look as { shape: object }).shape, colour("truth")));
    this.request();
  }

  showTruth(shown: boolean): void {
    this.truths.visible = shown;
    this.request();
  }

  close(): void {
    this.closed = true;
    this.observer.disconnect();
    clearTimeout(this.asked);
    this.views.controls.dispose();
    this.scene.traverse((part) => (part as Mesh).geometry?.dispose());
    this.renderer.dispose();
    this.renderer.domElement.remove();
    this.tools.replaceChildren();
  }

  // One group for each body, with a mesh for its look. A body that is no longer there leaves.
  private update(host: Group, bodies: Body[], state: LiveState, make: (look: object) => Object3D): void {
    const there = new Set(bodies.map((body) => body.id));
    for (const group of [...host.children]) if (!there.has(group.name)) host.remove(group);
    for (const body of bodies) {
      let group = host.children.find((each) => each.name === body.id);
      if (!group) {
        group = new Group();
        group.name = body.id;
        host.add(group);
      }
      place(group, body.pose);
      const packed = state.looks[body.look];
      if (group.userData.look === body.look || packed === undefined) continue;
      group.userData.look = body.look;
      void this.look(body.look, packed).then((look) => {
        if (this.closed || group.userData.look !== body.look) return;
        group.clear();
        group.add(make(look));
        this.request();
      });
    }
  }

  private look(name: string, packed: string): Promise<object> {
    let found = this.looks.get(name);
    if (!found) this.looks.set(name, (found = unpack(packed).then((sections: { look: object }) => sections.look)));
    return found;
  }

  // With room for where the arm goes next.
  private bounds(): Sphere {
    const sphere = boundsOf(this.robot, [], this.fixed) as Sphere;
    sphere.radius *= 1.2;
    return sphere;
  }

  private resize(): void {
    const { clientWidth: width, clientHeight: height } = this.host;
    if (!width || !height) return;
    this.renderer.setSize(width, height, false);
    if (this.state) Object.assign(this.views, { bounds: this.bounds() });
    this.views.resize(width, height);
    this.request();
  }

  // Drawn only when something is another, at most once a frame. Where drawing is slow, as without a graphics
  // card, the page keeps three quarters of the time for all else.
  private request(): void {
    if (this.asked || this.closed) return;
    this.asked = setTimeout(() => requestAnimationFrame(() => this.draw()), Math.max(0, this.nextDrawing - performance.now()));
  }

  private draw(): void {
    this.asked = 0;
    if (this.closed || !this.host.clientWidth) return;
    const began = performance.now();
    this.renderer.render(this.scene, this.views.camera);
    requestAnimationFrame(() => {
      const cost = performance.now() - began;
      this.nextDrawing = performance.now() + (cost > SLOW ? 3 * cost : 0);
    });
  }
}

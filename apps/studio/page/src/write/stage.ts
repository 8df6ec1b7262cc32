// The scene in 3-D: bodies as meshes, the robot at home, cameras as pyramids. Fixtures and bins are dragged on their level.

import {
  AmbientLight, BufferGeometry, Color, DirectionalLight, DoubleSide, EdgesGeometry, Float32BufferAttribute, Group, LineBasicMaterial, LineSegments, Mesh, MeshLambertMaterial, PerspectiveCamera, Plane,
  Raycaster, Scene, Vector2, Vector3, WebGLRenderer,
} from "three";
import { OrbitControls } from "three/examples/jsm/controls/OrbitControls.js";

export interface Shape {
  vertices: number[];
  faces: number[];
}

interface Placed {
  name: string;
  position: [number, number, number];
  quaternion: [number, number, number, number];
}

export interface Body extends Placed, Shape {
  kind: "fixture" | "bin" | "item";
  colour: [number, number, number];
}

export interface SceneContent {
  name: string;
  file: string;
  bodies: Body[];
  cameras: (Placed & { fov: number; size: [number, number] })[];
  views: string[];
}

const CAMERA_SIZE = 0.09; // m

export class Stage {
  private readonly scene = new Scene();
  private readonly camera = new PerspectiveCamera(42, 1, 0.02, 20);
  private readonly renderer: WebGLRenderer;
  private readonly controls: OrbitControls;
  private readonly bodies = new Group();
  private readonly robot = new Group();
  private readonly watch: ResizeObserver;
  private drawn = 0;
  private dragged: { name: string; parts: { mesh: Mesh; from: Vector3 }[]; plane: Plane; grip: Vector3 } | null = null;
  private chosen = "";

  constructor(private readonly host: HTMLElement, private readonly movable: () => boolean, private readonly onChoose: (name: string) => void, private readonly onMove: (name: string, x: number, y: number) => void) {
    this.renderer = new WebGLRenderer({ antialias: true, alpha: true });
    this.renderer.setPixelRatio(Math.min(devicePixelRatio, 2));
    const canvas = this.renderer.domElement;
    canvas.setAttribute("aria-hidden", "true");
    host.append(canvas);
    this.camera.up.set(0, 0, 1);
    this.camera.position.set(1.75, -1.25, 1.25);
    this.controls = new OrbitControls(this.camera, canvas);
    this.controls.target.set(0.35, 0, 0.1);
    this.controls.addEventListener("change", () => this.draw());
    const sun = new DirectionalLight(0xffffff, 2.2);
    sun.position.set(1, -1.4, 2.6);
    this.scene.add(new AmbientLight(0xffffff, 1.5), sun, this.bodies, this.robot);
    canvas.addEventListener("pointerdown", this.pressed);
    canvas.addEventListener("pointermove", this.pulled);
    canvas.addEventListener("pointerup", this.released);
    this.watch = new ResizeObserver(() => this.resize());
    this.watch.observe(host);
    this.controls.update();
    this.resize();
  }

  close(): void {
    this.watch.disconnect();
    this.controls.dispose();
    this.clear(this.bodies);
    this.clear(this.robot);
    this.renderer.dispose();
    this.renderer.domElement.remove();
  }

  show(content: SceneContent): void {
    this.clear(this.bodies);
    for (const body of content.bodies) {
      const mesh = meshOf(body, new Color().setRGB(...body.colour, "srgb"));
      place(mesh, body);
      mesh.name = body.name;
      mesh.userData.movable = body.kind !== "item";
      this.bodies.add(mesh);
    }
    for (const camera of content.cameras) this.bodies.add(pyramid(camera));
    this.choose(this.chosen);
  }

  showRobot(shape: Shape): void {
    this.clear(this.robot);
    this.robot.add(meshOf(shape, new Color(0xb8c2cc)));
    this.draw();
  }

  choose(name: string): void {
    this.chosen = name;
    for (const mesh of this.bodies.children)
      if (mesh instanceof Mesh) (mesh.material as MeshLambertMaterial).emissive.set(name && mesh.name === name ? 0x2a5ca8 : 0);
    this.draw();
  }

  private clear(group: Group): void {
    for (const each of [...group.children]) {
      group.remove(each);
      if (each instanceof Mesh || each instanceof LineSegments) {
        each.geometry.dispose();
        (each.material as MeshLambertMaterial).dispose();
      }
    }
  }

  private ray(event: PointerEvent): Raycaster {
    const box = this.renderer.domElement.getBoundingClientRect();
    const at = new Vector2(((event.clientX - box.left) / box.width) * 2 - 1, 1 - ((event.clientY - box.top) / box.height) * 2);
    const ray = new Raycaster();
    ray.setFromCamera(at, this.camera);
    return ray;
  }

  private readonly pressed = (event: PointerEvent) => {
    const hit = this.ray(event).intersectObjects(this.bodies.children.filter((each) => each instanceof Mesh), false)[0];
    if (!hit || !hit.object.userData.movable) return;
    const name = hit.object.name;
    this.choose(name);
    this.onChoose(name);
    // A table is not grabbed by accident: a second press on what is chosen drags it, as do all smaller bodies.
    if (!this.movable() || (name === "table" && !event.shiftKey)) return;
    const parts = this.bodies.children.filter((each): each is Mesh => each instanceof Mesh && each.name === name).map((mesh) => ({ mesh, from: mesh.position.clone() }));
    this.dragged = { name, parts, plane: new Plane(new Vector3(0, 0, 1), -hit.point.z), grip: hit.point.clone() };
    this.controls.enabled = false;
    this.renderer.domElement.setPointerCapture(event.pointerId);
  };

  private readonly pulled = (event: PointerEvent) => {
    const dragged = this.dragged;
    if (!dragged) return;
    const at = this.ray(event).ray.intersectPlane(dragged.plane, new Vector3());
    if (!at) return;
    for (const part of dragged.parts) part.mesh.position.copy(part.from).add(at.clone().sub(dragged.grip).setZ(0));
    this.draw();
  };

  private readonly released = () => {
    const dragged = this.dragged;
    this.dragged = null;
    this.controls.enabled = true;
    if (!dragged) return;
    const { mesh, from } = dragged.parts[0]!;
    if (mesh.position.distanceTo(from) > 0.001) this.onMove(dragged.name, mesh.position.x, mesh.position.y);
  };

  private resize(): void {
    const { clientWidth: width, clientHeight: height } = this.host;
    if (!width || !height) return;
    this.renderer.setSize(width, height);
    this.camera.aspect = width / height;
    this.camera.updateProjectionMatrix();
    this.draw();
  }

  private draw(): void {
    cancelAnimationFrame(this.drawn);
    this.drawn = requestAnimationFrame(() => this.renderer.render(this.scene, this.camera));
  }
}

function meshOf(shape: Shape, colour: Color): Mesh {
  const indexed = new BufferGeometry();
  indexed.setAttribute("position", new Float32BufferAttribute(shape.vertices, 3));
  indexed.setIndex(shape.faces);
  const flat = indexed.toNonIndexed();
  indexed.dispose();
  flat.computeVertexNormals();
  return new Mesh(flat, new MeshLambertMaterial({ color: colour, side: DoubleSide }));
}

function place(object: Mesh | LineSegments, at: Placed): void {
  object.position.set(...at.position);
  object.quaternion.set(...at.quaternion);
}

// A camera looks along z of its frame.
function pyramid(camera: SceneContent["cameras"][number]): LineSegments {
  const height = CAMERA_SIZE * Math.tan(camera.fov / 2);
  const width = (height * camera.size[0]) / camera.size[1];
  const corners = [[-width, -height], [width, -height], [width, height], [-width, height]];
  const geometry = new BufferGeometry();
  geometry.setAttribute("position", new Float32BufferAttribute([0, 0, 0, ...corners.flatMap(([x, y]) => [x!, y!, CAMERA_SIZE])], 3));
  geometry.setIndex([0, 1, 2, 0, 2, 3, 0, 3, 4, 0, 4, 1, 1, 3, 2, 1, 4, 3]);
  const lines = new LineSegments(new EdgesGeometry(geometry), new LineBasicMaterial({ color: 0x3a78c8 }));
  geometry.dispose();
  place(lines, camera);
  return lines;
}

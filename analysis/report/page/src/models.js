// Geometry of what analysis/report/stage_panel.py packed, and how it looks.

import {
  BoxGeometry, BufferAttribute, BufferGeometry, Color, CylinderGeometry, EdgesGeometry, Group, LineBasicMaterial,
  LineSegments, Mesh, MeshLambertMaterial, SphereGeometry, SRGBColorSpace,
} from "three";

export function shapeGeometry(shape, coloured = false) {
  if (shape.box) return new BoxGeometry(...shape.box);
  // three's cylinders stand along y.
  if (shape.cylinder) return new CylinderGeometry(shape.cylinder[0], shape.cylinder[0], shape.cylinder[1], 48).rotateX(Math.PI / 2);
  if (shape.sphere) return new SphereGeometry(shape.sphere, 32, 20);
  return meshGeometry(shape.mesh, coloured);
}

export function meshGeometry(packed, coloured = true) {
  const geometry = new BufferGeometry();
  geometry.setAttribute("position", new BufferAttribute(packed.vertices, 3));
  geometry.setAttribute("normal", new BufferAttribute(packed.normals, 3, true));
  if (coloured) geometry.setAttribute("color", new BufferAttribute(linear(packed.colours), 3));
  geometry.setIndex(new BufferAttribute(packed.faces, 1));
  return geometry;
}

function linear(bytes) {
  const found = new Float32Array(bytes.length);
  const colour = new Color();
  for (let i = 0; i < bytes.length; i += 3) {
    colour.setRGB(bytes[i] / 255, bytes[i + 1] / 255, bytes[i + 2] / 255, SRGBColorSpace);
    found.set([colour.r, colour.g, colour.b], i);
  }
  return found;
}

export function painted([red, green, blue]) {
  return new Color().setRGB(red, green, blue, SRGBColorSpace);
}

// A solid body: as it is believed. The columns of a heap have the colours of their heights.
export function solid(look) {
  const obstacle = look.role === "obstacle";
  const heap = look.role === "heap" && Boolean(look.shape.mesh);
  const mesh = new Mesh(
    shapeGeometry(look.shape, heap),
    new MeshLambertMaterial({
      color: heap ? new Color(1, 1, 1) : painted(look.colour),
      vertexColors: heap,
      transparent: obstacle,
      opacity: obstacle ? 0.35 : 1,
    }),
  );
  mesh.castShadow = !obstacle;
  mesh.receiveShadow = true;
  return mesh;
}

// Edges and a breath of colour: as it truly is.
export function ghost(shape, lineColour) {
  const group = new Group();
  const geometry = shapeGeometry(shape);
  const body = new Mesh(
    geometry,
    new MeshLambertMaterial({ color: lineColour, transparent: true, opacity: 0.12, depthWrite: false }),
  );
  const edges = new LineSegments(
    edgesOf(shape, geometry),
    new LineBasicMaterial({ color: lineColour, transparent: true }),
  );
  group.add(body, edges);
  Object.assign(group, { body, edges });
  return group;
}

// A ball has no edges; three circles stand for it.
function edgesOf(shape, geometry) {
  if (!shape.sphere) return new EdgesGeometry(geometry, 30);
  const points = [];
  const around = 40;
  for (let axis = 0; axis < 3; axis += 1) {
    for (let k = 0; k < around; k += 1) {
      for (const step of [k, k + 1]) {
        const angle = (2 * Math.PI * step) / around;
        const point = [0, 0, 0];
        point[axis] = shape.sphere * Math.cos(angle);
        point[(axis + 1) % 3] = shape.sphere * Math.sin(angle);
        points.push(...point);
      }
    }
  }
  const circles = new BufferGeometry();
  circles.setAttribute("position", new BufferAttribute(new Float32Array(points), 3));
  return circles;
}

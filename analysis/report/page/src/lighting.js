// Light, shadow and ground of the scene, on light and on dark pages.

import { AmbientLight, Color, DirectionalLight, GridHelper, HemisphereLight } from "three";

import { colour } from "./theme.js";

const UNDER_THE_TABLE = -0.041; // m

export class Lighting {
  constructor(scene) {
    this.scene = scene;
    this.sky = new HemisphereLight(0xffffff, 0x8a8f99, 1.6);
    this.sun = new DirectionalLight(0xffffff, 2.2);
    this.sun.position.set(0.9, -0.8, 2.2);
    this.sun.target.position.set(0.4, 0, 0);
    this.sun.castShadow = true;
    const { shadow } = this.sun;
    shadow.mapSize.set(2048, 2048);
    Object.assign(shadow.camera, { left: -1.3, right: 1.3, top: 1.3, bottom: -1.3, near: 0.2, far: 5 });
    Object.assign(shadow, { bias: -0.0004, normalBias: 0.006, radius: 3 });
    scene.add(this.sky, new AmbientLight(0xffffff, 0.25), this.sun, this.sun.target);
  }

  theme() {
    const dark = document.documentElement.dataset.theme === "dark";
    this.scene.background = new Color(colour("stage"));
    this.sky.intensity = dark ? 0.7 : 1.45;
    this.sun.intensity = dark ? 1.4 : 2;
    if (this.grid) {
      this.scene.remove(this.grid);
      this.grid.dispose();
    }
    const line = new Color(colour("rim"));
    this.grid = new GridHelper(6, 30, line, line);
    this.grid.rotation.x = Math.PI / 2;
    this.grid.position.z = UNDER_THE_TABLE;
    Object.assign(this.grid.material, { transparent: true, opacity: dark ? 0.35 : 0.5 });
    this.scene.add(this.grid);
  }
}

// Belief against truth in words: remarks in the corner of the scene, and tags at the bodies.

import { Vector3 } from "three";

import { TOLERANCE } from "./actors.js";

const MOST = 3; // differences that are named, the largest first
const ABOVE = new Vector3(0, 0, 0.045); // of a body's middle, m

// [[class, text], …]. `choice`: the search that is shown, if any.
export function remarksOf(believed, truths, choice) {
  const seen = believed.filter((one) => one.group.visible);
  const said = seen.filter(({ look }) => look.remark).map(({ look }) => ["heights", look.remark]);
  if (choice) said.push(["choice", choice.summary]);
  said.push(...seen.filter((one) => one.isHeld).map(({ id }) => ["held", `holds ${id}`]));
  const apart = truths
    .filter((one) => one.state === "gone" || differs(one))
    .sort((a, b) => (b.distance || Infinity) - (a.distance || Infinity));
  for (const one of apart.slice(0, MOST)) {
    const words = one.state === "gone" ? "is not there" : `is ${length(one.distance)} off`;
    said.push(["apart", `${one.partner.id} ${words}`]);
  }
  if (apart.length > MOST) said.push(["apart", `and ${apart.length - MOST} more`]);
  const unknown = truths.filter((one) => one.state === "unknown").length;
  if (unknown) said.push(["apart", `${unknown} not known to the robot`]);
  return said;
}

// [[point, text, class], …]
export function differencesOf(truths) {
  const tags = [];
  for (const one of truths) {
    if (one.state === "gone") tags.push([one.partner.group.position, "not there", "apart"]);
    else if (differs(one)) {
      const middle = one.partner.group.position.clone().lerp(one.ghost.position, 0.5);
      tags.push([middle, length(one.distance), "apart"]);
    }
  }
  return tags;
}

// Of everything when `all`, else of what was picked.
export function namesOf(believed, truths, places, picked, all) {
  const tags = [];
  for (const one of believed) {
    if (!one.group.visible || !(all || one === picked?.object)) continue;
    tags.push([one.group.position.clone().add(ABOVE), one === picked?.object ? described(one) : one.id, "name"]);
  }
  if (all) for (const [id, at] of places) tags.push([at, id, "name"]);
  for (const one of truths) {
    if (one !== picked?.truth || !one.ghost.visible) continue;
    tags.push([one.ghost.position.clone().add(ABOVE), `${one.id} (${one.kind}), truly`, "name"]);
  }
  if (picked?.label) tags.push([picked.at, picked.label, "name"]);
  return tags;
}

function described({ id, isHeld, look }) {
  const where = isHeld ? "in the hand" : look.place;
  return [`${id}: ${look.kind}`, where].filter(Boolean).join(", ");
}

function differs(one) {
  return one.state === "both" && one.distance > TOLERANCE;
}

function length(metres) {
  return metres >= 0.1 ? `${(metres * 100).toFixed(0)} cm` : `${(metres * 1000).toFixed(0)} mm`;
}

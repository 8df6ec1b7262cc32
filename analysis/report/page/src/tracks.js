// Poses over time, smooth between two ticks.

import { Quaternion, Vector3 } from "three";

const nextP = new Vector3();
const nextQ = new Quaternion();

// Writes the pose at `tick` plus a share of the way to the next one.
export function poseAt(track, tick, share, position, quaternion) {
  const { p, q } = track;
  position.fromArray(p, tick * 3);
  quaternion.fromArray(q, tick * 4);
  const next = Math.min(tick + 1, p.shape[0] - 1);
  if (share > 0 && next !== tick) {
    position.lerp(nextP.fromArray(p, next * 3), share);
    nextQ.fromArray(q, next * 4);
    quaternion.set(
      quaternion.x + share * (nextQ.x - quaternion.x),
      quaternion.y + share * (nextQ.y - quaternion.y),
      quaternion.z + share * (nextQ.z - quaternion.z),
      quaternion.w + share * (nextQ.w - quaternion.w),
    );
  }
  quaternion.normalize();
}

// Whether a tick lies in one of the spans [first, last].
export function within(spans, tick) {
  return spans.some(([first, last]) => first <= tick && tick <= last);
}

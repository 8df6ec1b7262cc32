// The place of runs that go on: one of them, or what goes on and how to start another.

import type { Place } from "../routing";
import { LiveRun } from "./LiveRun";
import { StartRun } from "./StartRun";

export function Live({ place }: { place: Place }) {
  return place.rest ? <LiveRun id={place.rest} key={place.rest} /> : <StartRun mission={place.query.get("mission") ?? ""} />;
}

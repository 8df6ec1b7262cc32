import type { Route } from "../routing";
import { Missions } from "./Missions";
import { WritePage } from "./WritePage";

export const routes: Route[] = [
  { name: "write", title: (place) => place.rest || "Missions", nav: "Missions", Component: ({ place }) => (place.rest ? <WritePage path={place.rest} /> : <Missions />) },
];

import type { Route } from "../routing";
import { RunIndex } from "./RunIndex";
import { RunPage } from "./RunPage";

export const routes: Route[] = [
  { name: "runs", title: () => "Runs", nav: "Runs", covers: ["run"], Component: RunIndex },
  { name: "run", title: (place) => place.rest.split("/").pop() ?? "", Component: RunPage },
];

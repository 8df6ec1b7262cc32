import "./batches.css";

import type { Route } from "../routing";
import { BatchIndex } from "./BatchIndex";
import { BatchPage } from "./BatchPage";
import { PlanPage } from "./PlanPage";

export const routes: Route[] = [
  { name: "batches", title: () => "Batches", nav: "Batches", covers: ["batch", "plan"], Component: BatchIndex },
  { name: "batch", title: (place) => place.rest.split("/").pop() ?? "", Component: BatchPage },
  { name: "plan", title: (place) => place.rest, Component: PlanPage },
];

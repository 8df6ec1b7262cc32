// The slices of the studio, in the order of the navigation.

import { routes as batches } from "./batches";
import { routes as live } from "./live";
import { routes as runs } from "./runs";
import { routes as start } from "./start";
import { routes as write } from "./write";
import type { Route } from "./routing";

export const ROUTES: Route[] = [...start, ...write, ...live, ...runs, ...batches];

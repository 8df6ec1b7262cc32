import type { Route } from "../routing";

export const routes: Route[] = [];

import type { Route } from "../routing";
import { Live } from "./Live";

export const routes: Route[] = [{ name: "live", title: (place) => (place.rest ? `Run ${place.rest}` : "Run"), nav: "Run", Component: Live }];

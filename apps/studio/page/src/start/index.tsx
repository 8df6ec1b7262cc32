import type { Route } from "../routing";
import { Start } from "./Start";

export const routes: Route[] = [{ name: "", title: () => "", Component: Start }];

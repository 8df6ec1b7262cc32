// Routes in the hash of the address: `#/run/runs/a?t=3.5` is the path "run/runs/a" with its query.

import { useSyncExternalStore } from "react";
import type { ComponentType } from "react";

export interface Place {
  // First part of the path, as "run".
  name: string;
  // The rest of the path, decoded: an id or a path of a file; empty when there is none.
  rest: string;
  query: URLSearchParams;
}

export interface Route {
  name: string;
  // Title of the page in the window, for a place.
  title(place: Place): string;
  // Words in the navigation; without them the route is not named there.
  nav?: string;
  // Names of routes for which the navigation marks this one.
  covers?: string[];
  Component: ComponentType<{ place: Place }>;
}

export function parse(hash: string): Place {
  const [path = "", query = ""] = hash.replace(/^#\/?/, "").split("?", 2);
  const slash = path.indexOf("/");
  const name = slash < 0 ? path : path.slice(0, slash);
  const rest = slash < 0 ? "" : path.slice(slash + 1);
  return { name, rest: decoded(rest), query: new URLSearchParams(query) };
}

function decoded(text: string): string {
  try {
    return text.split("/").map(decodeURIComponent).join("/");
  } catch {
    return text;
  }
}

// The hash of a place.
export function href(name: string, rest = "", query: Record<string, string | number> = {}): string {
  const path = rest ? `${name}/${rest.split("/").map(encodeURIComponent).join("/")}` : name;
  const words = new URLSearchParams(Object.entries(query).map(([key, value]) => [key, String(value)])).toString();
  return `#/${path}${words ? `?${words}` : ""}`;
}

export function go(hash: string): void {
  location.hash = hash;
}

// Changes the address without a new entry in the history.
export function replace(hash: string): void {
  history.replaceState(null, "", hash);
  dispatchEvent(new HashChangeEvent("hashchange"));
}

export function usePlace(): Place {
  const hash = useSyncExternalStore(
    (listener) => {
      addEventListener("hashchange", listener);
      return () => removeEventListener("hashchange", listener);
    },
    () => location.hash,
  );
  return parse(hash);
}

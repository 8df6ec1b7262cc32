// Bundles tree_harness.tsx into the file that is named.
import { build } from "esbuild";
import path from "node:path";

const here = import.meta.dirname;
await build({
  absWorkingDir: here,
  entryPoints: ["tree_harness.tsx"],
  outfile: process.argv[2],
  bundle: true,
  format: "iife",
  jsx: "automatic",
  nodePaths: [path.join(here, "node_modules")],
  define: { "process.env.NODE_ENV": '"production"' },
  loader: { ".css": "empty" },
  logLevel: "error",
});

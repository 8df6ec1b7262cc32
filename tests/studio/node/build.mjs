// Makes apps/studio/page/{studio.js,studio.css,licences.txt}; OUT names another folder.
import { build } from "esbuild";
import { mkdir, readFile, readdir, writeFile } from "node:fs/promises";
import path from "node:path";

const here = import.meta.dirname;
const page = path.resolve(here, "../../../apps/studio/page");
const out = process.env.OUT ? path.resolve(process.env.OUT) : page;
const modules = path.join(here, "node_modules");

const made = await build({
  absWorkingDir: here,
  entryPoints: { studio: path.join(page, "src/main.tsx") },
  outdir: out,
  bundle: true,
  minify: true,
  format: "iife",
  target: "es2022",
  charset: "utf8",
  jsx: "automatic",
  nodePaths: [modules],
  legalComments: "none",
  define: { "process.env.NODE_ENV": '"production"' },
  banner: {
    js: "/* picktree studio: Apache License 2.0, Copyright 2026 the picktree authors. Made from src/ beside this file, with the libraries of licences.txt in it. */",
  },
  metafile: true,
  logLevel: "warning",
});
await mkdir(out, { recursive: true });

// The licence of every library of which something is in the bundle.
const inside = /node_modules\/((?:@[^/]+\/)?[^/]+)\//;
const names = new Set();
for (const input of Object.keys(made.metafile.inputs)) {
  const found = inside.exec(input);
  if (found) names.add(found[1]);
}
const parts = [];
for (const name of [...names].sort()) {
  const folder = path.join(modules, name);
  const { version, license } = JSON.parse(await readFile(path.join(folder, "package.json"), "utf8"));
  const file = (await readdir(folder)).find((each) => /^licen[cs]e/i.test(each));
  const text = file ? (await readFile(path.join(folder, file), "utf8")).trim() : "";
  parts.push(`${name} ${version}: ${license}\n\n${text}`);
}
const head = "studio.js and studio.css have parts of these libraries in them.\n";
await writeFile(path.join(out, "licences.txt"), `${head}\n${parts.join(`\n\n${"-".repeat(80)}\n`)}\n`);

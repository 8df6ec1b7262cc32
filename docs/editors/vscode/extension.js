// Starts `picktree lsp` for YAML files; the server leaves files alone that are not picktree's.
const fs = require("node:fs");
const path = require("node:path");
const vscode = require("vscode");
const { LanguageClient } = require("vscode-languageclient/node");

let client;

exports.activate = () => {
  const folder = vscode.workspace.workspaceFolders?.[0]?.uri.fsPath ?? ".";
  client = new LanguageClient(
    "picktree",
    { command: command(folder), args: ["lsp"] },
    { documentSelector: [{ language: "yaml" }] },
  );
  return client.start();
};

exports.deactivate = () => client?.stop();

function command(folder) {
  const named = vscode.workspace.getConfiguration("picktree").get("command");
  const own = path.join(folder, ".venv", "bin", "picktree");
  if (named === "picktree" && fs.existsSync(own)) return own;
  return named.includes("/") ? path.resolve(folder, named) : named;
}

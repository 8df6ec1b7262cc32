// Starts `picktree lsp` for YAML files; the server leaves files alone that are not picktree's.
const path = require("node:path");
const vscode = require("vscode");
const { LanguageClient } = require("vscode-languageclient/node");

let client;

exports.activate = () => {
  const folder = vscode.workspace.workspaceFolders?.[0]?.uri.fsPath ?? ".";
  const named = vscode.workspace.getConfiguration("picktree").get("command");
  const command = named.includes("/") ? path.resolve(folder, named) : named;
  client = new LanguageClient("picktree", { command, args: ["lsp"] }, { documentSelector: [{ language: "yaml" }] });
  return client.start();
};

exports.deactivate = () => client?.stop();

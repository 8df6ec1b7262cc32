// The editor of a mission: that of YAML, with what the server knows of missions.

import { autocompletion, completionKeymap, insertCompletionText, snippet } from "@codemirror/autocomplete";
import type { Completion, CompletionContext, CompletionResult } from "@codemirror/autocomplete";
import { redo, redoDepth, undo, undoDepth } from "@codemirror/commands";
import { lintGutter, lintKeymap, setDiagnostics } from "@codemirror/lint";
import type { Diagnostic } from "@codemirror/lint";
import { Annotation, EditorSelection, StateEffect, StateField } from "@codemirror/state";
import type { EditorState } from "@codemirror/state";
import { Decoration, EditorView, hoverTooltip, keymap } from "@codemirror/view";
import type { DecorationSet, Tooltip } from "@codemirror/view";

import { call } from "../connection";
import { makeYamlEditor } from "../ui/YamlEditor";
import type { Change, TextFault } from "./model";

export { redo, undo };

// Marks a change that the picture made, whose tree is known already.
export const ByPicture = Annotation.define<boolean>();

const showNode = StateEffect.define<{ from: number; to: number } | null>();
const shownNode = StateField.define<DecorationSet>({
  create: () => Decoration.none,
  update(before, transaction) {
    let now = before.map(transaction.changes);
    for (const effect of transaction.effects) {
      if (!effect.is(showNode)) continue;
      const span = effect.value;
      now = span && span.to > span.from ? Decoration.set([Decoration.mark({ class: "cm-node" }).range(span.from, span.to)]) : Decoration.none;
    }
    return now;
  },
  provide: (field) => EditorView.decorations.from(field),
});

export interface EditorEvents {
  // After each change; `byPicture`: the picture knows of it.
  changed(text: string, byPicture: boolean): void;
  // The cursor was moved by its user.
  moved(place: number): void;
  save(): void;
}

export function makeEditor(parent: HTMLElement, path: string, text: string, events: EditorEvents): EditorView {
  return makeYamlEditor(parent, `Text of ${path}`, text, [
    lintGutter(), shownNode,
    autocompletion({ override: [(context) => complete(path, context)], icons: true }),
    hoverTooltip((view, place) => hover(path, view, place)),
    keymap.of([{ key: "Mod-s", preventDefault: true, run: () => { events.save(); return true; } }, ...completionKeymap, ...lintKeymap]),
    EditorView.updateListener.of((update) => {
      if (update.docChanged) events.changed(update.state.doc.toString(), update.transactions.some((each) => each.annotation(ByPicture)));
      else if (update.selectionSet && update.view.hasFocus) events.moved(update.state.selection.main.head);
    }),
  ]);
}

export const canUndo = (view: EditorView) => undoDepth(view.state) > 0;
export const canRedo = (view: EditorView) => redoDepth(view.state) > 0;

export function applyChanges(view: EditorView, changes: Change[], byPicture: boolean): void {
  view.dispatch({ changes, annotations: byPicture ? ByPicture.of(true) : [], userEvent: "input.picture" });
}

// Marks the text of a node, and brings its first line into view.
export function markNode(view: EditorView, span: { from: number; to: number } | null, scroll: boolean): void {
  const shown = view.state.field(shownNode).iter();
  const same = span && span.to > span.from ? shown.from === span.from && shown.to === span.to : !shown.value;
  if (same && !scroll) return;
  const effects: StateEffect<unknown>[] = [showNode.of(span)];
  if (span && scroll) {
    const from = Math.min(span.from, view.state.doc.length);
    // The line's beginning, and as much up to the node as there is room for.
    effects.push(EditorView.scrollIntoView(EditorSelection.range(from, view.state.doc.lineAt(from).from), { y: "center" }));
  }
  view.dispatch({ effects });
}

export function showFaults(view: EditorView, faults: TextFault[]): void {
  const length = view.state.doc.length;
  const found = faults.filter((fault) => fault.from <= length).map((fault): Diagnostic => ({
    from: fault.from,
    to: Math.min(Math.max(fault.to, fault.from), length),
    severity: fault.severity,
    source: fault.code,
    message: fault.message,
    actions: fault.fix ? [{ name: `Write ${fault.fix.insert}`, apply: (shown) => applyChanges(shown, [fault.fix!], false) }] : [],
  }));
  view.dispatch(setDiagnostics(view.state, found));
}

function position(view: EditorState, place: number): { line: number; character: number } {
  const line = view.doc.lineAt(place);
  return { line: line.number - 1, character: place - line.from };
}

interface Offered {
  from: number;
  to: number;
  options: { label: string; kind: string; snippet: string; doc: string; include: string; also?: Change }[];
}

const TYPES: Record<string, string> = { node: "class", tree: "function", key: "property", value: "enum", blackboard: "variable" };

async function complete(path: string, context: CompletionContext): Promise<CompletionResult | null> {
  const before = context.matchBefore(/[\w.*/+-]*/);
  const sign = context.state.sliceDoc(Math.max(0, context.pos - 1), context.pos);
  if (!context.explicit && !before?.text && !/[{["' ]/.test(sign)) return null;
  if (!context.explicit && sign === " " && !/:\s$|-\s$/.test(context.state.sliceDoc(Math.max(0, context.pos - 2), context.pos))) return null;
  const found = await call<Offered | null>("mission.complete", { path, text: context.state.doc.toString(), ...position(context.state, context.pos) }).catch(() => null);
  if (!found?.options.length || context.aborted) return null;
  return { from: found.from, to: found.to, options: found.options.map((each, rank) => option(each, rank)), validFor: /^[\w.*/+-]*$/ };
}

function option(offered: Offered["options"][number], rank: number): Completion {
  return {
    label: offered.label,
    detail: offered.include || undefined,
    type: TYPES[offered.kind],
    boost: -Math.min(rank, 99),
    info: offered.doc ? () => words(offered.doc) : undefined,
    apply: (view, completion, from, to) => {
      // What comes before it in the file is written last, so that places stay right.
      if (offered.snippet === offered.label) view.dispatch(insertCompletionText(view.state, offered.label, from, to));
      else snippet(unescaped(offered.snippet))(view, completion, from, to);
      if (offered.also) applyChanges(view, [offered.also], false);
    },
  };
}

// A snippet of the language server as CodeMirror has them: `$1` and `$0` become fields, `\}` and `\$` themselves.
function unescaped(text: string): string {
  let stops = 100;
  return text.replace(/\\([\\$}])|\$\{(\d+):((?:\\.|[^}\\])*)\}|\$(\d+)/g, (_, sign: string, number: string, inner: string, bare: string) => {
    if (sign) return sign === "}" ? "\\}" : sign;
    if (number) return `\${${number}:${inner.replace(/\\([\\$}])/g, (_each, escaped: string) => (escaped === "}" ? "\\}" : escaped))}}`;
    return bare === "0" ? `\${${stops++}}` : `\${${bare}}`;
  });
}

interface Hovered {
  from: number;
  to: number;
  text: string;
}

async function hover(path: string, view: EditorView, place: number): Promise<Tooltip | null> {
  const found = await call<Hovered | null>("mission.hover", { path, text: view.state.doc.toString(), ...position(view.state, place) }).catch(() => null);
  if (!found) return null;
  return { pos: found.from, end: found.to, above: true, create: () => ({ dom: words(found.text) }) };
}

// Markdown of a documentation as text: paragraphs, code and emphasis, no markup of its own.
export function words(text: string): HTMLElement {
  const holder = document.createElement("div");
  holder.className = "cm-words";
  holder.tabIndex = 0; // it may scroll, so keys reach it
  for (const part of text.split(/\n{2,}/)) {
    const fenced = /^```\w*\n([\s\S]*?)\n?```$/.exec(part.trim());
    const block = document.createElement(fenced ? "pre" : "p");
    if (fenced) block.textContent = fenced[1]!;
    else
      for (const piece of part.split(/(`[^`]+`|\*\*[^*]+\*\*|\*[^*\n]+\*)/)) {
        const kind = piece.startsWith("`") ? "code" : piece.startsWith("**") ? "b" : piece.startsWith("*") && piece.length > 2 ? "em" : "";
        if (!kind) block.append(piece);
        else {
          const inner = document.createElement(kind);
          inner.textContent = piece.replace(/^(`|\*{1,2})|(`|\*{1,2})$/g, "");
          block.append(inner);
        }
      }
    holder.append(block);
  }
  return holder;
}

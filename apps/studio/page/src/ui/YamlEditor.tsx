// The editor of YAML: CodeMirror in the page's colours. Tab leaves it; Ctrl-] and Ctrl-[ indent.

import { closeBrackets, closeBracketsKeymap } from "@codemirror/autocomplete";
import { defaultKeymap, history, historyKeymap } from "@codemirror/commands";
import { yaml } from "@codemirror/lang-yaml";
import { HighlightStyle, bracketMatching, foldGutter, foldKeymap, indentUnit, syntaxHighlighting } from "@codemirror/language";
import { highlightSelectionMatches, searchKeymap } from "@codemirror/search";
import { EditorState } from "@codemirror/state";
import type { Extension } from "@codemirror/state";
import { EditorView, drawSelection, highlightActiveLine, highlightActiveLineGutter, keymap, lineNumbers } from "@codemirror/view";
import { tags } from "@lezer/highlight";
import { useEffect, useRef } from "react";

const COLOURS = HighlightStyle.define([
  { tag: [tags.propertyName, tags.definition(tags.propertyName)], color: "var(--reference)" },
  { tag: [tags.string, tags.special(tags.string)], color: "var(--success_text)" },
  { tag: [tags.number, tags.bool, tags.null], color: "var(--output)" },
  { tag: tags.comment, color: "var(--muted)", fontStyle: "italic" },
  { tag: [tags.keyword, tags.labelName, tags.typeName], color: "var(--cure_ink)" },
]);

const LOOK = EditorView.theme({
  "&": { height: "100%", fontSize: "13px", backgroundColor: "var(--sheet)", color: "var(--ink)" },
  ".cm-scroller": { fontFamily: "var(--mono)", lineHeight: "1.5" },
  ".cm-content": { caretColor: "var(--ink)" },
  ".cm-cursor": { borderLeftColor: "var(--ink)" },
  ".cm-gutters": { backgroundColor: "var(--bar)", color: "var(--muted)", borderRight: "1px solid var(--rim)" },
  ".cm-activeLine": { backgroundColor: "color-mix(in srgb, var(--running_fill) 35%, transparent)" },
  ".cm-activeLineGutter": { backgroundColor: "var(--running_fill)", color: "var(--ink)" },
  "&.cm-focused > .cm-scroller > .cm-selectionLayer .cm-selectionBackground, .cm-selectionBackground": { backgroundColor: "color-mix(in srgb, var(--running) 28%, transparent)" },
  ".cm-node": { backgroundColor: "color-mix(in srgb, var(--running) 14%, transparent)", borderRadius: "3px" },
  ".cm-tooltip": { backgroundColor: "var(--sheet)", color: "var(--ink)", border: "1px solid var(--rim)", borderRadius: "8px", boxShadow: "0 6px 24px rgb(0 0 0 / 22%)", maxWidth: "min(520px, 90vw)" },
  ".cm-tooltip-autocomplete ul li[aria-selected]": { backgroundColor: "var(--reference)", color: "var(--sheet)" },
  ".cm-diagnostic-error": { borderLeftColor: "var(--failure)" },
  ".cm-diagnostic-warning": { borderLeftColor: "var(--cure_rim)" },
  ".cm-diagnosticAction": { backgroundColor: "var(--reference)", color: "var(--sheet)", borderRadius: "6px", padding: "3px 8px", minHeight: "24px" },
  ".cm-lintRange-error": { backgroundImage: "none", textDecoration: "underline wavy var(--failure) 1.5px", textUnderlineOffset: "3px" },
  ".cm-lintRange-warning": { backgroundImage: "none", textDecoration: "underline wavy var(--cure_rim) 1.5px", textUnderlineOffset: "3px" },
  ".cm-panels": { backgroundColor: "var(--bar)", color: "var(--ink)" },
  ".cm-foldPlaceholder": { backgroundColor: "var(--bar)", border: "1px solid var(--rim)", color: "var(--muted)" },
});

// What every editor of YAML in the studio has.
const BASICS: Extension = [
  lineNumbers(), foldGutter(), history(), drawSelection(), bracketMatching(), closeBrackets(), highlightActiveLine(), highlightActiveLineGutter(), highlightSelectionMatches(),
  indentUnit.of("  "), EditorState.lineSeparator.of("\n"), yaml(), syntaxHighlighting(COLOURS), LOOK,
  keymap.of([...closeBracketsKeymap, ...searchKeymap, ...historyKeymap, ...foldKeymap, ...defaultKeymap]),
];

// An editor in an element; `extensions` have precedence.
export function makeYamlEditor(parent: HTMLElement, label: string, text: string, extensions: Extension): EditorView {
  const made = new EditorView({
    parent,
    state: EditorState.create({ doc: text, extensions: [extensions, BASICS, EditorView.contentAttributes.of({ "aria-label": label })] }),
  });
  made.scrollDOM.tabIndex = 0; // it scrolls, so keys reach it
  made.scrollDOM.setAttribute("role", "group");
  made.scrollDOM.setAttribute("aria-label", `${label}, scrolled`);
  return made;
}

export interface YamlEditorProps {
  label: string;
  // Text at the start; later changes of it replace what is there.
  text: string;
  onChange(text: string): void;
}

export function YamlEditor({ label, text, onChange }: YamlEditorProps) {
  const host = useRef<HTMLDivElement>(null);
  const view = useRef<EditorView | null>(null);
  const tell = useRef(onChange);
  tell.current = onChange;
  useEffect(() => {
    const made = makeYamlEditor(host.current!, label, text, EditorView.updateListener.of((update) => { if (update.docChanged) tell.current(update.state.doc.toString()); }));
    view.current = made;
    return () => made.destroy();
    // The editor keeps its document: it is made once.
  }, []);
  useEffect(() => {
    const shown = view.current!;
    const now = shown.state.doc.toString();
    if (now !== text) shown.dispatch({ changes: { from: 0, to: now.length, insert: text } });
  }, [text]);
  return <div className="yaml-editor" ref={host} />;
}

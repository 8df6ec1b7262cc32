// A plain editor for YAML: CodeMirror in the page's colours. Tab leaves it; Ctrl-] and Ctrl-[ indent.

import { defaultKeymap, history, historyKeymap } from "@codemirror/commands";
import { yaml } from "@codemirror/lang-yaml";
import { HighlightStyle, bracketMatching, indentOnInput, syntaxHighlighting } from "@codemirror/language";
import { highlightSelectionMatches, searchKeymap } from "@codemirror/search";
import { EditorState } from "@codemirror/state";
import type { Extension } from "@codemirror/state";
import { EditorView, drawSelection, highlightActiveLine, keymap, lineNumbers } from "@codemirror/view";
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
  "&": { height: "100%", backgroundColor: "var(--sheet)", color: "var(--ink)", fontSize: "13px" },
  ".cm-scroller": { fontFamily: "var(--mono)", lineHeight: "1.5" },
  ".cm-content": { caretColor: "var(--ink)" },
  ".cm-cursor": { borderLeftColor: "var(--ink)" },
  ".cm-gutters": { backgroundColor: "var(--bar)", color: "var(--muted)", border: "none" },
  ".cm-activeLine, .cm-activeLineGutter": { backgroundColor: "color-mix(in srgb, var(--running_fill) 40%, transparent)" },
  "&.cm-focused .cm-selectionBackground, .cm-selectionBackground": { backgroundColor: "var(--running_fill) !important" },
});

// What every editor of YAML in the studio has.
export const yamlBasics: Extension = [
  lineNumbers(), history(), drawSelection(), indentOnInput(), bracketMatching(), highlightActiveLine(), highlightSelectionMatches(),
  yaml(), syntaxHighlighting(COLOURS), LOOK, keymap.of([...defaultKeymap, ...historyKeymap, ...searchKeymap]),
];

export interface YamlEditorProps {
  label: string;
  // Text at the start; later changes of it replace what is there.
  text: string;
  onChange(text: string): void;
  extensions?: Extension;
  className?: string;
}

export function YamlEditor({ label, text, onChange, extensions = [], className }: YamlEditorProps) {
  const host = useRef<HTMLDivElement>(null);
  const view = useRef<EditorView | null>(null);
  const tell = useRef(onChange);
  tell.current = onChange;
  useEffect(() => {
    const made = new EditorView({
      parent: host.current!,
      state: EditorState.create({
        doc: text,
        extensions: [
          yamlBasics,
          EditorView.contentAttributes.of({ "aria-label": label }),
          EditorView.updateListener.of((update) => { if (update.docChanged) tell.current(update.state.doc.toString()); }),
          extensions,
        ],
      }),
    });
    made.scrollDOM.tabIndex = 0; // it scrolls, so keys reach it
    made.scrollDOM.setAttribute("role", "group");
    made.scrollDOM.setAttribute("aria-label", `${label}, scrolled`);
    view.current = made;
    return () => made.destroy();
    // The editor keeps its document: it is made once.
  }, []);
  useEffect(() => {
    const shown = view.current!;
    const now = shown.state.doc.toString();
    if (now !== text) shown.dispatch({ changes: { from: 0, to: now.length, insert: text } });
  }, [text]);
  return <div className={`yaml-editor ${className ?? ""}`} ref={host} />;
}

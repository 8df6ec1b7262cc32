// A sentence of a docstring: what stands between backticks is code, all else is text.

export function Prose({ text }: { text: string }) {
  return <>{text.split(/`([^`]+)`/).map((part, number) => (number % 2 ? <code key={number}>{part}</code> : part))}</>;
}

// The same where only plain text can be shown, as in a title.
export const plain = (text: string) => text.replace(/`([^`]+)`/g, "$1");

// SPDX-License-Identifier: Apache-2.0
// 20 x 20, drawn with the colour of the text around them.
const PATHS = {
  play: <path d="M6 4.2v11.6a.6.6 0 0 0 .9.5l9.4-5.8a.6.6 0 0 0 0-1L6.9 3.7a.6.6 0 0 0-.9.5Z" fill="currentColor" />,
  pause: <path d="M6.5 4v12M13.5 4v12" stroke-width="3" />,
  stop: <rect x="5" y="5" width="10" height="10" rx="1.5" fill="currentColor" />,
  again: <path d="M15.6 8A6 6 0 1 0 16 11.5M16 4v4.2h-4.2" />,
  previous: <path d="M12.5 4.5 7 10l5.5 5.5" />,
  next: <path d="M7.5 4.5 13 10l-5.5 5.5" />,
  newest: <path d="M5 4.5 10.5 10 5 15.5M14.5 4.5v11" />,
  point: <path d="M10 2.5v4M10 13.5v4M2.5 10h4M13.5 10h4M10 9.99v.02" />,
  brush: <path d="M16.8 3.2 9.4 10.6M9 10.2c-2.6-.5-4.2 1.1-4.5 3.1-.15 1.2-.8 2-1.9 2.5 1.7 1.1 5.4 1.4 7-.3 1.3-1.3 1.2-3.3-.6-5.300Z" />,
  outline: <><path d="M4.5 8.2 11 4l5 5.500-3 6.500H6.200Z" /><path d="M4.5 8.200v.01M11 4v.01M16 9.500v.01M13 16v.01M6.2 16v.01" stroke-width="3.4" /></>,
  undo: <path d="M7.5 4.500 4 8l3.500 3.500M4 8h7.500a4.250 4.250 0 0 1 0 8.500H8" />,
  check: <path d="M4.5 10.500 8.500 14.500 16 6" />,
  grid: <path d="M5 5v.01M10 5v.01M15 5v.01M5 10v.01M10 10v.01M15 10v.01M5 15v.01M10 15v.01M15 15v.01" stroke-width="2.6" />,
  color: <path d="M10 2.800c3 3.5 4.7 5.8 4.7 8.200a4.7 4.7 0 0 1-9.4 0c0-2.4 1.7-4.7 4.7-8.200ZM10 13.200a2.2 2.2 0 0 0 2.2-2.2" />,
  bin: <path d="M4 5.500h12M8 5.500V3.800h4v1.700M5.5 5.500l.7 10.700h7.600l.7-10.700M8.5 8.500v5M11.5 8.500v5" />,
  sun: <path d="M10 6.600a3.4 3.4 0 1 0 0 6.8 3.4 3.4 0 0 0 0-6.800ZM10 1.800v1.700M10 16.500v1.700M1.8 10h1.700M16.5 10h1.700M4.2 4.200l1.2 1.200M14.6 14.600l1.2 1.200M4.2 15.800l1.2-1.200M14.6 5.400l1.2-1.2" />,
  moon: <path d="M16.5 11.800A7 7 0 0 1 8.2 3.500a7 7 0 1 0 8.3 8.300Z" />,
  help: <path d="M7.3 7.400a2.7 2.7 0 1 1 4 2.400c-.9.5-1.3 1-1.3 2M10 14.700v.01" />,
  film: <path d="M3.5 4.500h13v11h-13zM3.5 8h13M3.5 12h13M7 4.500V8M7 12v3.500M13 4.500V8M13 12v3.5" />,
  file: <path d="M5 2.800h6.500L15.5 7v10.200H5zM11.3 3v4.200h4" />,
  pictures: <path d="M3 5.500h11v9H3zM6 5.500v-2h11v9h-3M3 12.500l3-3 3 3 2-2 3 3" />,
  camera: <path d="M3 6h9v8H3zM12 9.200l5-2.700v7l-5-2.7" />,
  close: <path d="M5 5l10 10M15 5 5 15" />,
  download: <path d="M10 3v9M6.5 8.8 10 12.300l3.5-3.500M4 16h12" />,
  whole: <path d="M3.5 7.500v-4h4M12.5 3.500h4v4M16.5 12.500v4h-4M7.5 16.500h-4v-4" />,
};

export type IconName = keyof typeof PATHS;

export function Icon({ name }: { name: IconName }) {
  return (
    <svg class="icon" viewBox="0 0 20 20" aria-hidden="true" fill="none" stroke="currentColor" stroke-width="1.6" stroke-linecap="round" stroke-linejoin="round">
      {PATHS[name]}
    </svg>
  );
}

/** A button that shows an icon only; its name is spoken, and shown with its key while the pointer rests on it. */
export function IconButton(props: {
  icon: IconName;
  name: string;
  keys?: string;
  pressed?: boolean;
  disabled?: boolean;
  class?: string;
  onClick: () => void;
}) {
  return (
    <button
      type="button"
      class={`icon-button ${props.class ?? ""}`}
      aria-label={props.name}
      title={props.keys ? `${props.name} (${props.keys})` : props.name}
      aria-pressed={props.pressed}
      disabled={props.disabled}
      onClick={props.onClick}
    >
      <Icon name={props.icon} />
    </button>
  );
}

//! Commands and their answers (GenCP 1.3 chapter 4, with the prefix of USB3 Vision 1.1).

use super::memory::Refusal;

const PREFIX: [u8; 4] = *b"U3VC";
const READ_MEMORY: u16 = 0x0800;
const WRITE_MEMORY: u16 = 0x0802;
const HEADER: usize = 12;
const NOT_IMPLEMENTED: u16 = 0x8001;

/// What the host asks.
#[derive(Debug, PartialEq, Eq)]
pub(super) enum Request {
    Read {
        address: u64,
        bytes: u16,
    },
    Write {
        address: u64,
        data: Vec<u8>,
    },
    /// A command that the camera does not know.
    Other,
}

/// A request, and what its answer must repeat.
#[derive(Debug)]
pub(super) struct Command {
    pub(super) request: Request,
    code: u16,
    id: u16,
}

impl Command {
    /// Nothing where the bytes are not a command: they are then not answered.
    pub(super) fn parse(bytes: &[u8]) -> Option<Self> {
        let word = |at: usize| Some(u16::from_le_bytes([*bytes.get(at)?, *bytes.get(at + 1)?]));
        if !bytes.starts_with(&PREFIX) || bytes.len() != HEADER + usize::from(word(8)?) {
            return None;
        }
        let (code, id) = (word(6)?, word(10)?);
        let address = || Some(u64::from_le_bytes(bytes.get(HEADER..HEADER + 8)?.try_into().ok()?));
        let request = match code {
            READ_MEMORY => Request::Read { address: address()?, bytes: word(HEADER + 10)? },
            WRITE_MEMORY => Request::Write { address: address()?, data: bytes[HEADER + 8..].to_vec() },
            _ => Request::Other,
        };
        Some(Command { request, code, id })
    }

    /// The answer, with what was read.
    pub(super) fn answer(&self, outcome: Result<&[u8], Refusal>) -> Vec<u8> {
        let (status, data) = match (outcome, &self.request) {
            (_, Request::Other) => (NOT_IMPLEMENTED, Vec::new()),
            (Ok(data), Request::Read { .. }) => (0, data.to_vec()),
            // Reserved, and how many bytes were written.
            (Ok(_), Request::Write { data, .. }) => {
                let [low, high] = (data.len() as u16).to_le_bytes();
                (0, vec![0, 0, low, high])
            }
            (Err(refusal), _) => (refusal as u16, Vec::new()),
        };
        let mut answer = PREFIX.to_vec();
        for word in [status, self.code + 1, data.len() as u16, self.id] {
            answer.extend(word.to_le_bytes());
        }
        answer.extend(data);
        answer
    }
}

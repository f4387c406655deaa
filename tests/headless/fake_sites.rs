//! Sites with certificates of their own authority, for tests of downloads.
#![cfg(unix)]

use std::io::{BufRead, BufReader, Read, Write};
use std::net::{TcpListener, TcpStream};
use std::path::Path;
use std::process::{Command, Output};
use std::sync::{Arc, Mutex};

use rcgen::{BasicConstraints, CertificateParams, IsCa, Issuer, KeyPair};
use rustls::pki_types::PrivateKeyDer;
use rustls::{ServerConfig, ServerConnection, StreamOwned};

/// Hosts of the download addresses.
pub const HOSTS: [&str; 2] = ["github.com", "files.pythonhosted.org"];

/// Returns a site's response to the first line of a request.
type Answer = fn(&str) -> Vec<u8>;

/// Writes a site's response to a request.
type Respond = dyn Fn(&SiteRequest, &mut dyn Write) -> std::io::Result<()> + Send + Sync;

/// Request to a site.
pub struct SiteRequest {
    /// Its first line.
    pub line: String,
    /// First and last byte that it asks for; the last is `None` for all that follow.
    pub range: Option<(u64, Option<u64>)>,
}

/// A proxy that responds for all sites, with certificates of its own authority.
pub struct FakeSites {
    proxy: String,
    /// Certificate of the authority in PEM format.
    pub authority: String,
    /// First line of every request, including those to the proxy.
    requests: Arc<Mutex<Vec<String>>>,
}

impl FakeSites {
    /// Starts sites whose responses are complete at once.
    pub fn start(answer: Answer) -> Self {
        Self::start_writing(move |request, stream| stream.write_all(&answer(&request.line)))
    }

    /// Starts sites that answer each request on a thread of its own.
    pub fn start_writing(
        respond: impl Fn(&SiteRequest, &mut dyn Write) -> std::io::Result<()> + Send + Sync + 'static,
    ) -> Self {
        let respond: Arc<Respond> = Arc::new(respond);
        let mut authority = CertificateParams::default();
        authority.is_ca = IsCa::Ca(BasicConstraints::Unconstrained);
        let authority_key = KeyPair::generate().unwrap();
        let pem = authority.self_signed(&authority_key).unwrap().pem();
        let key = KeyPair::generate().unwrap();
        let certificate = CertificateParams::new(HOSTS.map(String::from))
            .unwrap()
            .signed_by(&key, &Issuer::new(authority, authority_key))
            .unwrap();
        let provider = Arc::new(rustls::crypto::ring::default_provider());
        let config = ServerConfig::builder_with_provider(provider)
            .with_safe_default_protocol_versions()
            .unwrap()
            .with_no_client_auth()
            .with_single_cert(
                vec![certificate.der().clone()],
                PrivateKeyDer::try_from(key.serialize_der()).unwrap(),
            )
            .unwrap();
        let config = Arc::new(config);
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let proxy = format!("http://{}", listener.local_addr().unwrap());
        let requests = Arc::new(Mutex::new(Vec::new()));
        let log = Arc::clone(&requests);
        std::thread::spawn(move || {
            for stream in listener.incoming() {
                let (config, log, respond) = (config.clone(), log.clone(), respond.clone());
                std::thread::spawn(move || {
                    // The test checks clients that close the connection early; the server ignores them.
                    let _ = serve(stream.unwrap(), &config, &log, &*respond);
                });
            }
        });
        Self {
            proxy,
            authority: pem,
            requests,
        }
    }

    pub fn requests(&self) -> Vec<String> {
        self.requests.lock().unwrap().clone()
    }

    /// Runs `ostra models install NAME` in `folder/cwd` and trusts the sites' authority.
    ///
    /// Only the programs in the folders `path` and those of the shell are available.
    pub fn install(&self, folder: &Path, name: &str, path: &str) -> Output {
        self.install_trusting(&self.authority, folder, name, path)
    }

    pub fn install_trusting(
        &self,
        authority: &str,
        folder: &Path,
        name: &str,
        path: &str,
    ) -> Output {
        self.command(authority, folder, name, path)
            .output()
            .unwrap()
    }

    pub fn command(&self, authority: &str, folder: &Path, name: &str, path: &str) -> Command {
        let (cwd, certificates) = (folder.join("cwd"), folder.join("authority.pem"));
        std::fs::create_dir_all(&cwd).unwrap();
        std::fs::write(&certificates, authority).unwrap();
        let mut command = Command::new(env!("CARGO_BIN_EXE_ostra"));
        command
            .args(["models", "install", name])
            .current_dir(cwd)
            .env("PATH", path);
        command
            .env("XDG_DATA_HOME", folder.join("data"))
            .env("HOME", folder)
            .env_remove("ORT_DYLIB_PATH");
        for own in ["OSTRA_NETWORKS", "OSTRA_MIRROR", "HF_ENDPOINT"] {
            command.env_remove(own);
        }
        for other in ["ALL_PROXY", "HTTP_PROXY", "NO_PROXY", "HTTPS_PROXY"] {
            command.env_remove(other).env_remove(other.to_lowercase());
        }
        command
            .env("HTTPS_PROXY", &self.proxy)
            .env("SSL_CERT_FILE", certificates)
            .env_remove("SSL_CERT_DIR");
        command
    }
}

/// Serves one connection to the proxy: its own request, or one request through a tunnel.
fn serve(
    stream: TcpStream,
    config: &Arc<ServerConfig>,
    log: &Mutex<Vec<String>>,
    respond: &Respond,
) -> std::io::Result<()> {
    let request = read_request(&stream)?;
    log.lock().unwrap().push(request.line.clone());
    if !request.line.starts_with("CONNECT ") {
        return respond(&request, &mut &stream);
    }
    (&stream).write_all(b"HTTP/1.1 200 OK\r\n\r\n")?;
    let connection = ServerConnection::new(Arc::clone(config)).unwrap();
    let mut tunnel = StreamOwned::new(connection, stream);
    let request = read_request(&mut tunnel)?;
    log.lock().unwrap().push(request.line.clone());
    respond(&request, &mut tunnel)?;
    tunnel.conn.send_close_notify();
    tunnel.flush()
}

/// Reads the head of a request.
fn read_request(stream: impl Read) -> std::io::Result<SiteRequest> {
    let mut lines = BufReader::new(stream).lines();
    let line = lines.next().unwrap_or_else(|| Ok(String::new()))?;
    let mut range = None;
    for line in lines {
        let line = line?.to_lowercase();
        if line.is_empty() {
            break;
        }
        if let Some(bytes) = line.strip_prefix("range: bytes=") {
            let (first, last) = bytes.split_once('-').unwrap();
            range = Some((first.parse().unwrap(), last.parse().ok()));
        }
    }
    Ok(SiteRequest { line, range })
}

function socket = open_socket(host, port)
    % A connection, of MATLAB or of Octave's package instrument-control.
    if exist('OCTAVE_VERSION', 'builtin') && ~exist('tcpclient')
        pkg('load', 'instrument-control');
    end
    socket = tcpclient(host, port, 'Timeout', 1);
end

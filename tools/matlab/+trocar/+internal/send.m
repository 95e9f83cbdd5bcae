function send(socket, bytes)
    % Send bytes; an error when they cannot be sent. (Octave returns a number below 0 instead, MATLAB nothing.)
    if exist('OCTAVE_VERSION', 'builtin')
        if write(socket, bytes) < numel(bytes)
            error('it has closed the connection');
        end
    else
        write(socket, bytes);
    end
end

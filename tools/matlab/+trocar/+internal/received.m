function data = received(socket)
    % What has come, as text; empty when nothing has.
    waiting = double(socket.NumBytesAvailable);
    data = '';
    if waiting > 0
        bytes = read(socket, waiting);
        data = char(bytes(:).');
    end
end
